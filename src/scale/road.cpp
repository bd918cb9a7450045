#include "scale/road.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace ground_scale_vo {
namespace {

// Search for the visible band of the road.
constexpr double kBandHalfWidth = 1;                // [camera heights] about a lane
constexpr double kMinDistance = 1, kMaxAhead = 25;  // [camera heights]
constexpr double kOffsetStep = 0.25;                // [camera heights]
constexpr int kOffsetSteps = 40;                    // to either side
constexpr int kGridSize = 64;         // [rays] in a row and column of the image at most
constexpr double kRaySpacing = 0.03;  // [focal lengths] at least
/// Number of rays of a band, relative to the band with the most. The band on the path is used from
/// kVisibleShare on: with fewer, in a corner of the image, it shows too little road for a plane.
/// Otherwise the nearest band from kWellVisibleShare on is used.
constexpr double kVisibleShare = 0.25;
constexpr double kWellVisibleShare = 0.8;

/// Number of rays of a regular grid over the image that meet the road in each band.
using Histogram = std::array<int, 2 * kOffsetSteps + 1>;

/// Where a viewing ray meets the road, ahead and to the left of the point below the camera [camera
/// heights]. Empty: nowhere, farther along the path than max_ahead, or nearer than min_distance.
std::optional<Eigen::Vector2d> onRoad(const Eigen::Matrix3d& R_c_road, const Eigen::Vector3d& ray,
                                      double min_distance, double max_ahead) {
  const double down = -R_c_road.col(2).dot(ray);
  if (!(down > 0)) return std::nullopt;
  const double ahead = R_c_road.col(0).dot(ray) / down, left = R_c_road.col(1).dot(ray) / down;
  if (std::abs(ahead) > max_ahead) return std::nullopt;
  if (ahead * ahead + left * left < min_distance * min_distance) return std::nullopt;
  return Eigen::Vector2d(ahead, left);
}

}  // namespace

Eigen::Vector3d roadNormal(double pitch, double roll) {
  return {-std::sin(roll), -std::cos(roll) * std::cos(pitch), -std::cos(roll) * std::sin(pitch)};
}

double pitchOf(const Eigen::Vector3d& n_c) { return std::atan2(-n_c.z(), -n_c.y()); }

double rollOf(const Eigen::Vector3d& n_c) { return -std::asin(std::clamp(n_c.x(), -1.0, 1.0)); }

Eigen::Matrix3d roadAxes(const Eigen::Vector3d& n_c, const Eigen::Vector3d& direction_c) {
  const Eigen::Vector3d ahead = (direction_c - n_c.dot(direction_c) * n_c).normalized();
  Eigen::Matrix3d R_c_road;
  R_c_road << ahead, n_c.cross(ahead), n_c;
  return R_c_road;
}

void RoadPrior::addTo(const Eigen::Vector3d& m, double height,
                      Eigen::Ref<Eigen::Matrix3d, 0, Eigen::OuterStride<>> H,
                      Eigen::Ref<Eigen::Vector3d> b) const {
  for (const auto& [axis, sigma] :
       {std::pair(forward_c, pitch_sigma), std::pair(lateral(), roll_sigma)}) {
    const Eigen::Vector3d jacobian = height * axis / sigma;
    H += jacobian * jacobian.transpose();
    b -= jacobian * jacobian.dot(m);
  }
}

LaneRegion::LaneRegion(const RoadPrior& prior, double height, double min_distance, double max_ahead,
                       double half_width)
    : R_c_road_(prior.axes()),
      offset_(prior.region_offset),
      min_distance_(min_distance),
      max_ahead_(max_ahead),
      half_width_(half_width) {
  if (prior.chord && height > 0) {
    chord_length_ = prior.chord->length / height;
    curvature_ = prior.n_c.dot(prior.chord->turn_c) / chord_length_;
  }
}

bool LaneRegion::contains(const Eigen::Vector3d& ray) const {
  const auto point = onRoad(R_c_road_, ray, min_distance_, max_ahead_);
  if (!point) return false;
  // Lateral position of the path relative to the chord, not to the tangent at the camera: the
  // parabola of the given curvature through both ends of the chord (ahead = 0 and -chord_length_).
  const double path = 0.5 * curvature_ * point->x() * (point->x() + chord_length_);
  return std::abs(point->y() - path - offset_) <= half_width_;
}

double visibleRegionOffset(const PinholeCamera& camera, const RoadPrior& prior) {
  Histogram visible{};
  const Eigen::Matrix3d R_c_road = prior.axes();
  const double step_x = std::max(kRaySpacing * camera.fx, 1.0 * camera.width / kGridSize);
  const double step_y = std::max(kRaySpacing * camera.fy, 1.0 * camera.height / kGridSize);
  for (double y = 0.5 * step_y; y < camera.height; y += step_y) {
    for (double x = 0.5 * step_x; x < camera.width; x += step_x) {
      const auto point = onRoad(R_c_road, camera.ray({x, y}), kMinDistance, kMaxAhead);
      if (!point) continue;
      const double limit = kOffsetSteps;
      const double first = std::max(std::ceil((point->y() - kBandHalfWidth) / kOffsetStep), -limit);
      const double last = std::min(std::floor((point->y() + kBandHalfWidth) / kOffsetStep), limit);
      for (double k = first; k <= last; ++k) ++visible[static_cast<std::size_t>(k + limit)];
    }
  }
  const int best = *std::max_element(visible.begin(), visible.end());
  if (visible[kOffsetSteps] >= kVisibleShare * best) return 0;
  for (int k = 1; k <= kOffsetSteps; ++k) {
    for (const int side : {1, -1}) {
      const int count = visible[static_cast<std::size_t>(kOffsetSteps + side * k)];
      if (count >= kWellVisibleShare * best) return side * k * kOffsetStep;
    }
  }
  return 0;
}

}  // namespace ground_scale_vo
