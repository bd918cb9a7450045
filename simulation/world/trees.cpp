#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "simulation/world/world_builder.hpp"

namespace gsv::simulation {
namespace {

constexpr int kTreeKinds = 6, kLeavesInShadow = 150;
constexpr double kRightRow = -7.3, kLeftRow = 8.7;           // u of the two rows of trees [m]
constexpr double kTreeClearance = 6.8;                       // to the lane of a recorded road [m]
constexpr double kLampPostHeight = 6.5, kTrunkHeight = 3.6;  // [m]

/// A vertical, tapered prism with eight sides.
void addPrism(Mesh& mesh, double radius, double top_radius, double height, const Texture& texture,
              double light, const Eigen::Vector3d& sun) {
  constexpr int kSides = 8;
  const auto rim = [&](int k, double r, double z) {
    const double angle = 2 * M_PI * k / kSides;
    const Eigen::Vector3d normal(std::cos(angle), std::sin(angle), 0);
    return Vertex{r * normal + Eigen::Vector3d(0, 0, z),
                  {radius * angle, z},
                  light * diffuseLight(normal, sun)};
  };
  for (int k = 0; k < kSides; ++k) {
    mesh.addQuad(rim(k, radius, 0), rim(k + 1, radius, 0), rim(k + 1, top_radius, height),
                 rim(k, top_radius, height), texture);
  }
}

/// A sphere of leaves with a random relief.
void addCrown(Mesh& mesh, const Eigen::Vector3d& centre, double radius, WorldBuilder& builder) {
  constexpr int kMeridians = 18, kParallels = 11;
  std::array<std::array<Vertex, kMeridians + 1>, kParallels + 1> grid;
  const double v_offset = builder.uniform(0, 5), u_offset = builder.uniform(0, 5);
  const Eigen::Vector2d offset(u_offset, v_offset);
  for (std::size_t j = 0; j <= kParallels; ++j) {
    for (std::size_t i = 0; i <= kMeridians; ++i) {
      const double a = 2 * M_PI * static_cast<double>(i) / kMeridians;
      const double b = M_PI * (static_cast<double>(j) / kParallels - 0.5);
      const Eigen::Vector3d n(std::cos(b) * std::cos(a), std::cos(b) * std::sin(a), std::sin(b));
      const bool pole = j == 0 || j == kParallels;
      const double r = radius * (pole ? 1 : builder.uniform(0.78, 1.15));
      const double light = 0.55 * diffuseLight(n, builder.options.sun) + 0.3 + 0.25 * n.z() +
                           0.15 * (r / radius - 1);
      grid[j][i] = {centre + r * n, offset + radius * Eigen::Vector2d(a, 1.3 * b), light};
      if (i == kMeridians) grid[j][i].p = grid[j][0].p;
    }
  }
  for (std::size_t j = 0; j < kParallels; ++j) {
    for (std::size_t i = 0; i < kMeridians; ++i) {
      mesh.addQuad(grid[j][i], grid[j][i + 1], grid[j + 1][i + 1], grid[j + 1][i], *builder.leaves);
    }
  }
}

/// A trunk and a ring of crowns around a central one. kind: their number varies with it.
Mesh treeMesh(int kind, WorldBuilder& builder) {
  Mesh mesh;
  addPrism(mesh, builder.uniform(0.14, 0.24), 0.12, kTrunkHeight, *builder.stone, 0.45,
           builder.options.sun);
  const int crowns = 5 + kind % 3;
  for (int k = 0; k < crowns; ++k) {
    const double angle = 2 * M_PI * k / crowns + builder.uniform(-0.4, 0.4);
    const double distance = builder.uniform(0.7, 1.4);
    const double radius = builder.uniform(0.8, 1.25), height = builder.uniform(3.4, 5.6);
    addCrown(mesh, {distance * std::cos(angle), distance * std::sin(angle), height}, radius,
             builder);
  }
  addCrown(mesh, {0, 0, 5.2}, 1.5, builder);
  return mesh;
}

/// The trunk's shadow and many small spots between which light falls through the leaves.
void castTreeShadow(double s, double u, WorldBuilder& builder) {
  builder.shadows.castPrism(s, u, {{0, 0.16}, {0, -0.16}}, 4, 0.5);
  for (int leaf = 0; leaf < kLeavesInShadow; ++leaf) {
    const double r = 2.2 * std::sqrt(builder.uniform(0, 1)), a = builder.uniform(0, 2 * M_PI);
    const double radius = builder.uniform(0.08, 0.36), height = builder.uniform(3, 6.4);
    builder.shadows.castSpot(s, u, {r * std::cos(a), r * std::sin(a), height}, radius);
  }
}

}  // namespace

void addTreesAndLampPosts(WorldBuilder& builder) {
  std::vector<const Mesh*> kinds;
  kinds.reserve(kTreeKinds);
  for (int kind = 0; kind < kTreeKinds; ++kind) {
    kinds.push_back(&builder.addMesh(treeMesh(kind, builder)));
  }
  Mesh post;
  addPrism(post, 0.08, 0.05, kLampPostHeight, *builder.stone, 0.6, builder.options.sun);
  const Mesh& lamp_post = builder.addMesh(std::move(post));

  const RoadGeometry& road = builder.road;
  for (const double u : {kRightRow, kLeftRow}) {
    for (double s = road.sBegin() + builder.uniform(0, 8); s < road.sEnd() - 3;
         s += builder.uniform(7, 15)) {
      Eigen::Isometry3d T_w_m = Eigen::Isometry3d::Identity();
      T_w_m.translation() = road.surfacePoint(s, u, builder.options.kerb_height);
      T_w_m.rotate(Eigen::AngleAxisd(builder.uniform(0, 2 * M_PI), Eigen::Vector3d::UnitZ()));
      const bool is_lamp_post = builder.random.chance(0.25);
      if (!builder.isClearOfBridgeAndUnderpass(s)) continue;
      if (road.isRecorded() && road.distanceToLane(s, T_w_m.translation()) < kTreeClearance)
        continue;
      if (is_lamp_post) {
        builder.place(lamp_post, T_w_m, s);
        builder.shadows.castPrism(s, u, {{0, 0.06}, {0, -0.06}}, kLampPostHeight, 0.4);
      } else {
        builder.place(*kinds[builder.random.bits() % kinds.size()], T_w_m, s);
        castTreeShadow(s, u, builder);
      }
    }
  }
}

}  // namespace gsv::simulation
