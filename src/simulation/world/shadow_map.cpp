#include "simulation/world/shadow_map.hpp"

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include "simulation/rendering/procedural_texture.hpp"
#include "simulation/world/cross_section.hpp"

namespace ground_scale_vo::simulation {
namespace {

constexpr int kRoadTexelsPerShadowTexel = 8;  // in each direction
constexpr double kShadowTexel_m = kRoadTexelsPerShadowTexel * kRoadTexel;
constexpr double kOpaqueShadowLoss = 0.5;    // share of the light that an opaque prism blocks
constexpr double kSpotTransmittance = 0.52;  // share of the light that remains in a spot
constexpr double kPenumbraSigma = 0.8;       // [shadow texels] blur of all shadows

}  // namespace

ShadowMap::ShadowMap(const RoadGeometry& road, const Eigen::Vector3d& sun, cv::Size road_texels)
    : road_(road),
      sun_(sun),
      road_texels_(road_texels),
      map_(road_texels.height / kRoadTexelsPerShadowTexel,
           road_texels.width / kRoadTexelsPerShadowTexel, CV_8U, cv::Scalar(255)) {}

Eigen::Vector2d ShadowMap::shadowUv(double s, double u, const Eigen::Vector3d& offset) const {
  const Eigen::Vector3d sun = Eigen::AngleAxisd(-road_.heading(s), Eigen::Vector3d::UnitZ()) * sun_;
  return roadTextureUv(road_.sBegin(), s + offset.x() - sun.x() / sun.z() * offset.z(),
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
  const Eigen::Vector2d uv = roadTextureUv(road_.sBegin(), s_begin, kTextureRight);
  TexturePainter(map_, kShadowTexel_m)
      .box(uv.x(), uv.y(), kRoadColumns * kRoadTexel, s_end - s_begin, 255 * light);
}

cv::Mat ShadowMap::light() const {
  cv::Mat light;
  cv::GaussianBlur(map_, light, {}, kPenumbraSigma);
  cv::resize(light, light, road_texels_, 0, 0, cv::INTER_LINEAR);
  return light;
}

}  // namespace ground_scale_vo::simulation
