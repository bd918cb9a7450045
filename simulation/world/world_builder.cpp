#include "simulation/world/world_builder.hpp"

#include <opencv2/imgproc.hpp>
#include <utility>

namespace gsv::simulation {
namespace {

constexpr int kRoadTexelsPerShadowTexel = 8;  // in each direction
constexpr double kShadowTexel_m = kRoadTexelsPerShadowTexel * kRoadTexel;
constexpr double kOpaqueShadowLoss = 0.5;    // share of the light that an opaque prism blocks
constexpr double kSpotTransmittance = 0.52;  // share of the light that remains in a spot
constexpr double kPenumbraSigma = 0.8;       // [shadow texels] blur of all shadows

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

ShadowMap::ShadowMap(const RoadGeometry& road, const Eigen::Vector3d& sun, cv::Size road_texels)
    : road_(road),
      sun_(sun),
      road_texels_(road_texels),
      map_(road_texels.height / kRoadTexelsPerShadowTexel,
           road_texels.width / kRoadTexelsPerShadowTexel, CV_8U, cv::Scalar(255)) {}

Eigen::Vector2d ShadowMap::shadowUv(double s, double u, const Eigen::Vector3d& offset) const {
  const Eigen::Vector3d sun = Eigen::AngleAxisd(-road_.heading(s), Eigen::Vector3d::UnitZ()) * sun_;
  return road_.textureUv(s + offset.x() - sun.x() / sun.z() * offset.z(),
                         u + offset.y() - sun.y() / sun.z() * offset.z());
}

void ShadowMap::castPrism(double s, double u, const std::vector<Eigen::Vector2d>& base,
                          double height, double opacity) {
  std::vector<cv::Point2f> points;
  for (const Eigen::Vector2d& p : base) {
    for (const double z : {0., height}) {
      const Eigen::Vector2d uv = shadowUv(s, u, {p.x(), p.y(), z});
      points.emplace_back(static_cast<float>(uv.x()), static_cast<float>(uv.y()));
    }
  }
  std::vector<cv::Point2f> hull;
  cv::convexHull(points, hull);
  std::vector<Eigen::Vector2d> corners;
  corners.reserve(hull.size());
  for (const cv::Point2f& p : hull) corners.emplace_back(p.x, p.y);
  TexturePainter(map_, kShadowTexel_m).polygon(corners, 255 * (1 - kOpaqueShadowLoss * opacity));
}

void ShadowMap::castSpot(double s, double u, const Eigen::Vector3d& offset, double radius) {
  TexturePainter(map_, kShadowTexel_m)
      .ellipse(shadowUv(s, u, offset), {radius, radius}, 255 * kSpotTransmittance);
}

void ShadowMap::setLight(double s_begin, double s_end, double light) {
  const Eigen::Vector2d uv = road_.textureUv(s_begin, kTextureRight);
  TexturePainter(map_, kShadowTexel_m)
      .box(uv.x(), uv.y(), kRoadColumns * kRoadTexel, s_end - s_begin, 255 * light);
}

cv::Mat ShadowMap::light() const {
  cv::Mat light;
  cv::GaussianBlur(map_, light, {}, kPenumbraSigma);
  cv::resize(light, light, road_texels_, 0, 0, cv::INTER_LINEAR);
  return light;
}

WorldBuilder::WorldBuilder(const RoadGeometry& road_geometry,
                           const SyntheticDrive::Options& drive_options, World* built_world)
    : road(road_geometry),
      options(drive_options),
      world(*built_world),
      random(drive_options.random_seed),
      road_texels(roadTexels(road_geometry)),
      shadows(road_geometry, drive_options.sun, road_texels) {
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
  return world.textures.emplace_back(image, texel_m, wrap);
}

const Mesh& WorldBuilder::addMesh(Mesh mesh) {
  mesh.updateBoundingSphere();
  return world.meshes.emplace_back(std::move(mesh));
}

void WorldBuilder::place(const Mesh& mesh, const Eigen::Isometry3d& T_w_m, double s) {
  world.scene.instances.push_back({&mesh, T_w_m, true, s});
}

void WorldBuilder::placeGround(Mesh mesh, double s) {
  world.scene.instances.push_back(
      {&addMesh(std::move(mesh)), Eigen::Isometry3d::Identity(), false, s});
}

bool WorldBuilder::isClearOfBridgeAndUnderpass(double s) const {
  constexpr double kClearance = 3;  // [m]
  return !options.bridge.contains(s, kClearance) && !options.underpass.contains(s, kClearance);
}

}  // namespace gsv::simulation
