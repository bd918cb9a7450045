#include <algorithm>
#include <utility>

#include "simulation/world/cross_section.hpp"
#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {
namespace {

/// A surface along the road between two points a and b of the cross-section (u, z).
void placeStrip(WorldBuilder& builder, double s_begin, double s_end, const Eigen::Vector2d& a,
                const Eigen::Vector2d& b, double light) {
  constexpr double kStep = 2;  // [m]
  const RoadGeometry& road = builder.road;
  Mesh mesh;
  const double width = (b - a).norm();
  const auto vertex = [&](double s, const Eigen::Vector2d& uz, double across) {
    return Vertex{road.surfacePoint(s, uz.x(), uz.y()), {across, s - road.sBegin()}, light};
  };
  for (double s = s_begin; s < s_end; s += kStep) {
    const double next = std::min(s + kStep, s_end);
    mesh.addQuad(vertex(s, a, 0), vertex(s, b, width), vertex(next, b, width), vertex(next, a, 0),
                 *builder.stone);
  }
  builder.place(builder.addMesh(std::move(mesh)), Eigen::Isometry3d::Identity());
}

}  // namespace

/// Parapets. The mesh of the road leaves out the verges of a bridge.
void addBridge(WorldBuilder& builder) {
  const double kerb = builder.options.kerb_height, top = kerb + 1.0;  // [m]
  constexpr double kThickness = 0.25, kBottom = -2;                   // [m]
  const double begin = builder.options.bridge_from_m, end = builder.options.bridge_to_m;
  for (const auto& [u, out] :
       {std::pair(kRightPavement, -kThickness), {kLeftPavement, kThickness}}) {
    placeStrip(builder, begin, end, {u, kerb}, {u, top}, 0.7);
    placeStrip(builder, begin, end, {u, top}, {u + out, top}, 1);
    placeStrip(builder, begin, end, {u + out, top}, {u + out, kBottom}, 0.6);
  }
}

/// Walls, a ceiling and both portals. The road below is dark.
void addUnderpass(WorldBuilder& builder) {
  constexpr double kClearance = 4.6, kThickness = 1.2, kPortalWidth = 8;  // [m]
  constexpr double kLight = 0.2;
  const double begin = builder.options.underpass_from_m, end = builder.options.underpass_to_m;
  const double kerb = builder.options.kerb_height;
  const double right = kRightPavement - 0.5, left = kLeftPavement + 0.5;
  for (const double u : {right, left}) {
    placeStrip(builder, begin, end, {u, kerb}, {u, kClearance}, kLight);
  }
  placeStrip(builder, begin, end, {right, kClearance}, {left, kClearance}, kLight);
  for (const double s : {begin, end}) {
    Mesh portal;
    const auto corner = [&](double u, double z) {
      return Vertex{builder.road.surfacePoint(s, u, z), {u, z}, 0.7};
    };
    const double outer_right = right - kPortalWidth, outer_left = left + kPortalWidth;
    portal.addQuad(corner(outer_right, kClearance), corner(outer_left, kClearance),
                   corner(outer_left, kClearance + kThickness),
                   corner(outer_right, kClearance + kThickness), *builder.stone);
    for (const auto& [a, b] : {std::pair(outer_right, right), {left, outer_left}}) {
      portal.addQuad(corner(a, kerb), corner(b, kerb), corner(b, kClearance), corner(a, kClearance),
                     *builder.stone);
    }
    builder.place(builder.addMesh(std::move(portal)), Eigen::Isometry3d::Identity());
  }
  builder.shadows.setLight(begin, end, kLight);
}

}  // namespace ground_scale_vo::simulation
