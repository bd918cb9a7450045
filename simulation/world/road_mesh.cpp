#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "simulation/world/world_builder.hpp"

namespace gsv::simulation {
namespace {

constexpr double kMeshStep = 0.5;     // of the mesh along s [m]
constexpr double kMeshLength = 10;    // of one mesh along s, so that it can be culled [m]
constexpr double kVergeEnd = 25;      // |u| of the outer border of the verges, at most [m]
constexpr double kBelowBridge = 9;    // depth of the terrain beside a bridge [m]
constexpr double kBelowVerges = 0.5;  // depth of the terrain beyond the verges [m]

/// |u| of the outer border of the verges [m]: before the centre of the tightest curve, beyond which
/// the mesh would fold.
double vergeEnd(const SyntheticDrive::Options& options) {  // of a generated road
  return std::min(kVergeEnd, 0.8 / std::max(options.curvature, 1e-9));
}

/// |u| up to which the road at s has kerb, pavement and verge on the side of `sign` [m]: kVergeEnd
/// on a generated road. On a recorded one they end where another part of the lane is nearer, so
/// that they neither fold in a tight curve nor lie on a crossing carriageway.
double borderEnd(const RoadGeometry& road, double s, double sign) {
  constexpr double kStepOut = 0.5, kTolerance = 0.3;  // [m]
  if (!road.isRecorded()) return kVergeEnd;
  double end = 0;
  for (double u = sign > 0 ? kLeftKerb : -kRightKerb; u <= kVergeEnd; u += kStepOut) {
    const Eigen::Vector3d p = road.surfacePoint(s, sign * u);
    const double clear = std::max(kLeftKerb + kTolerance, u - kTolerance);
    if (road.distanceToLane(s, p) < u - kTolerance || road.distanceToOtherLanes(s, p) < clear)
      break;
    end = u;
  }
  return end;
}

/// Height of ruts, tufts and holes over the smooth surface [m].
double roughness(double s, double u) {
  return 0.025 * std::sin(1.9 * s + 0.7 * u) + 0.02 * std::sin(3.1 * u - 1.3 * s + 1) +
         0.02 * std::sin(4.3 * s + 2.7 * u + 2);
}

/// Adds rough terrain instead of a road: gravel between the kerb positions, grass beyond them.
void addGravelTrack(WorldBuilder& builder) {
  constexpr double kWidth = 0.5;  // of the mesh along u [m]
  const RoadGeometry& road = builder.road;
  const Texture& gravel = builder.addTexture(
      noiseToGrey(
          tileableNoise({512, 512}, builder.random.bits(), {{0.8, 1}, {2, 1}, {8, 0.8}, {40, 0.8}}),
          118, 20),
      0.02);
  const double verge = vergeEnd(builder.options);
  const auto vertex = [&](double s, double u) {
    const double z = roughness(s, u);
    return Vertex{road.surfacePoint(s, u, z), {u, s - road.sBegin()}, 0.95 + 2 * z};
  };
  for (double first = road.sBegin(); first + kMeshStep < road.sEnd(); first += kMeshLength) {
    Mesh mesh;
    for (double s = first; s < std::min(first + kMeshLength, road.sEnd()); s += kMeshStep) {
      for (double u = -verge; u < verge; u += kWidth) {
        const bool is_track = u > kRightKerb && u < kLeftKerb;
        mesh.addQuad(vertex(s, u), vertex(s, u + kWidth), vertex(s + kMeshStep, u + kWidth),
                     vertex(s + kMeshStep, u), is_track ? gravel : *builder.grass);
      }
    }
    builder.placeGround(std::move(mesh));
  }
}

/// A flat part of the cross-section from (u, z) to (u_next, z_next) [m].
struct Strip {
  double u, z, u_next, z_next;
  bool verge;
  bool isKerbFace() const { return u == u_next; }
  bool isCarriageway() const { return u == kRightKerb && u_next == kLeftKerb; }
};

/// The ends of the borders at s, to the right and to the left [m]: u <= 0 and u >= 0.
struct Borders {
  Borders(const RoadGeometry& road, double s)
      : right(-borderEnd(road, s, -1)), left(borderEnd(road, s, 1)) {}
  double clamp(double u) const { return std::clamp(u, right, left); }
  bool hasKerb(double u) const { return (u < 0 ? right : left) != 0; }  // on the side of u
  double right, left;
};

/// Carriageway, kerbs, pavements and verges.
void addStreet(WorldBuilder& builder) {
  const RoadGeometry& road = builder.road;
  const SyntheticDrive::Options& options = builder.options;
  const double verge = road.isRecorded() ? kVergeEnd : vergeEnd(options);
  const double middle = std::min(14.0, (verge - kTextureRight) / 2);
  const double kerb = options.kerb_height;
  const std::array<Strip, 8> strips{{
      {-verge, kerb, -middle, kerb, true},
      {-middle, kerb, kTextureRight, kerb, true},
      {kTextureRight, kerb, kRightKerb, kerb, false},
      {kRightKerb, kerb, kRightKerb, 0, false},
      {kRightKerb, 0, kLeftKerb, 0, false},
      {kLeftKerb, 0, kLeftKerb, kerb, false},
      {kLeftKerb, kerb, kTextureLeft, kerb, false},
      {kTextureLeft, kerb, verge, kerb, true},
  }};
  // unrolled: of u, which is strip.u or strip.u_next.
  const auto vertex = [&](const Strip& strip, const Borders& borders, double s, double u, double z,
                          double unrolled) {
    const double inside = strip.isCarriageway() ? u : borders.clamp(u);
    const Eigen::Vector2d uv(strip.verge ? inside : unrolled + inside - u, s - road.sBegin());
    return Vertex{road.surfacePoint(s, inside, z), uv, strip.isKerbFace() ? 0.6 : 0.97};
  };
  // Whether the quad from one s to the next has no kerb at either, or lies beyond the end of both
  // borders.
  const auto isLeftOut = [](const Strip& strip, const Borders& from, const Borders& to) {
    if (strip.isCarriageway()) return false;
    if (!from.hasKerb(strip.u) || !to.hasKerb(strip.u)) return true;
    const auto isBeyond = [&](const Borders& borders) {
      return borders.clamp(strip.u) == borders.clamp(strip.u_next);
    };
    return !strip.isKerbFace() && isBeyond(from) && isBeyond(to);
  };
  const int per_mesh = static_cast<int>(kMeshLength / kMeshStep);
  const int steps = static_cast<int>((road.sEnd() - road.sBegin()) / kMeshStep);
  for (int first = 0; first < steps; first += per_mesh) {
    Mesh mesh;
    for (int k = first; k < std::min(first + per_mesh, steps); ++k) {
      const double s0 = road.sBegin() + kMeshStep * k, s1 = s0 + kMeshStep;
      const Borders borders0(road, s0), borders1(road, s1);
      double unrolled = 0;  // length of the cross-section up to here, in the texture
      for (const Strip& strip : strips) {
        const double begin = unrolled;
        if (!strip.verge) unrolled += strip.isKerbFace() ? kKerbFace : strip.u_next - strip.u;
        const bool on_bridge = options.bridge.contains(s0) && options.bridge.contains(s1);
        if (on_bridge && strip.verge) continue;
        if (isLeftOut(strip, borders0, borders1)) continue;
        mesh.addQuad(vertex(strip, borders0, s0, strip.u, strip.z, begin),
                     vertex(strip, borders0, s0, strip.u_next, strip.z_next, unrolled),
                     vertex(strip, borders1, s1, strip.u_next, strip.z_next, unrolled),
                     vertex(strip, borders1, s1, strip.u, strip.z, begin),
                     strip.verge ? *builder.grass : *builder.world.scene.road);
      }
    }
    builder.placeGround(std::move(mesh), road.sBegin() + kMeshStep * first);
  }
}

/// A horizontal plain of grass below the lowest point of the road.
void addTerrain(WorldBuilder& builder) {
  constexpr double kSize = 500;  // beyond the road, to all sides [m]
  const RoadGeometry& road = builder.road;
  Mesh plain;
  const double below = builder.options.bridge.exists() ? kBelowBridge : kBelowVerges;
  const double low = std::min(0.0, road.lowestElevation()) - road.surfacePoint(0, 0).z() - below;
  const auto corner = [&](double x, double y) {
    return Vertex{road.surfacePoint(0, 0, low) + Eigen::Vector3d(x, y, 0), {x, y}, 0.9};
  };
  const double far = road.sEnd() + kSize;
  const double back = road.isRecorded() ? far : kSize;  // a generated road never turns back
  plain.addQuad(corner(-back, -far), corner(far, -far), corner(far, far), corner(-back, far),
                *builder.grass);
  builder.placeGround(std::move(plain));
}

}  // namespace

void addRoadMesh(WorldBuilder& builder) {
  if (builder.options.off_road) {
    addGravelTrack(builder);
  } else {
    addStreet(builder);
  }
  addTerrain(builder);
}

}  // namespace gsv::simulation
