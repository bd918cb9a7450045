#include "simulation/world/world_builder.hpp"

#include <utility>

#include "simulation/rendering/procedural_texture.hpp"
#include "simulation/world/cross_section.hpp"

namespace ground_scale_vo::simulation {
namespace {

cv::Size roadTexels(const RoadGeometry& road) {
  // The number of rows is a multiple of this, so that it can be halved for the mip levels.
  constexpr int kMultiple = 64;
  const double length = road.sEnd() - road.sBegin();
  return {kRoadColumns, static_cast<int>(length / kRoadTexel / kMultiple + 1) * kMultiple};
}

/// Foliage texture: bright leaf clusters on a dark background.
cv::Mat leafImage(std::uint64_t seed) {
  cv::Mat leaves = tileableNoise({256, 256}, seed, {{1, 1}, {2, 1}, {6, 0.7}});
  cv::max(cv::min(leaves, 1.3), -1.3, leaves);
  return noiseToGrey(leaves, 96, 42);
}

cv::Mat roofTileImage(std::uint64_t seed) {
  cv::Mat image = noiseToGrey(tileableNoise({256, 256}, seed, {{1, 1}, {6, 1}}), 88, 9);
  for (int row = 0; row < 256; row += 8) image.row(row) *= 0.7;
  return image;
}

}  // namespace

WorldBuilder::WorldBuilder(const RoadGeometry& road_geometry, const WorldOptions& world_options,
                           WorldAssets* world_assets)
    : road(road_geometry),
      options(world_options),
      assets(*world_assets),
      random(world_options.random_seed),
      road_texels(roadTexels(road_geometry)),
      shadows(road_geometry, world_options.sun, road_texels) {
  leaves = &addTexture(leafImage(random.bits()), 0.02);
  grass = &addTexture(
      noiseToGrey(tileableNoise({512, 512}, random.bits(), {{1, 1}, {4, 1}, {20, 1.2}}), 92, 17),
      0.03);
  stone = &addTexture(
      noiseToGrey(tileableNoise({256, 256}, random.bits(), {{1, 1}, {5, 1}, {12, 1}}), 130, 16),
      0.015);
  roof_tiles = &addTexture(roofTileImage(random.bits()), 0.03);
}

const Texture& WorldBuilder::addTexture(const cv::Mat& image, double texel_m, Texture::Wrap wrap) {
  return assets.textures.emplace_back(image, texel_m, wrap);
}

const Mesh& WorldBuilder::addMesh(Mesh mesh) {
  mesh.updateBoundingSphere();
  return assets.meshes.emplace_back(std::move(mesh));
}

void WorldBuilder::place(const Mesh& mesh, const Eigen::Isometry3d& T_w_m, double s) {
  assets.scene.instances.push_back({&mesh, T_w_m, true, s});
}

void WorldBuilder::placeGround(Mesh mesh, double s) {
  assets.scene.instances.push_back(
      {&addMesh(std::move(mesh)), Eigen::Isometry3d::Identity(), false, s});
}

Eigen::Vector2d WorldBuilder::roadUv(double s, double u) const {
  return roadTextureUv(road.sBegin(), s, u);
}

bool WorldBuilder::isClearOfBridgeAndUnderpass(double s) const {
  constexpr double kClearance = 3;  // [m]
  const auto isNear = [&](double begin, double end) {
    return begin < end && isBetween(s, begin - kClearance, end + kClearance);
  };
  return !isNear(options.bridge_from_m, options.bridge_to_m) &&
         !isNear(options.underpass_from_m, options.underpass_to_m);
}

}  // namespace ground_scale_vo::simulation
