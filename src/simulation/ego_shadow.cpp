#include "simulation/ego_shadow.hpp"

#include <opencv2/imgproc.hpp>
#include <vector>

namespace ground_scale_vo::simulation {
namespace {

// The ego vehicle: its width, and its extent before and behind the camera [m].
constexpr double kWidth = 1.8, kFront = 2, kRear = 2.4;

/// hull: corners of a convex polygon in cyclic order, texture coordinates of the road [m].
PolygonShadow polygon(const std::vector<cv::Point2f>& hull) {
  PolygonShadow shadow;
  Eigen::Vector2d middle(0, 0);
  for (const cv::Point2f& p : hull) middle += Eigen::Vector2d(p.x, p.y);
  middle /= static_cast<double>(hull.size());
  for (std::size_t k = 0; k < hull.size(); ++k) {
    const cv::Point2f &a = hull[k], &b = hull[(k + 1) % hull.size()];
    const Eigen::Vector2d from(a.x, a.y), to(b.x, b.y);
    Eigen::Vector2d normal(from.y() - to.y(), to.x() - from.x());
    if (normal.norm() < 1e-3) continue;
    normal.normalize();
    if (normal.dot(middle - from) < 0) normal = -normal;
    shadow.edges.emplace_back(normal.x(), normal.y(), -normal.dot(from));
  }
  return shadow;
}

}  // namespace

PolygonShadow egoShadow(const SyntheticDrive::Options& options, const RoadGeometry& road,
                        const World& world, double s) {
  const Eigen::Vector3d sun =
      Eigen::AngleAxisd(-road.heading(s), Eigen::Vector3d::UnitZ()) * options.sun.normalized();
  const double roof = options.camera_height, half = kWidth / 2;
  std::vector<cv::Point2f> projected;
  // Projects the outline of the car at height z onto the road, along the rays of the sun.
  const auto project = [&](double rear, double front, double half_width, double z) {
    for (const double x : {rear, front}) {
      for (const double y : {-half_width, half_width}) {
        const Eigen::Vector2d uv = world.roadUv(s + x - sun.x() / sun.z() * z,
                                                options.lane_offset + y - sun.y() / sun.z() * z);
        projected.emplace_back(static_cast<float>(uv.x()), static_cast<float>(uv.y()));
      }
    }
  };
  project(-kRear, kFront, half, 0.2);                      // sill
  project(-kRear, kFront, half, 0.55 * roof);              // hood
  project(-0.8 * kRear, 0.2 * kFront, 0.75 * half, roof);  // roof
  std::vector<cv::Point2f> hull;
  cv::convexHull(projected, hull);
  return polygon(hull);
}

}  // namespace ground_scale_vo::simulation
