#include "scale/road.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

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

void addRay(const RoadPrior& prior, const Eigen::Vector3d& lateral, const Eigen::Vector3d& ray,
            Histogram* visible) {
  const double down = -prior.n_c.dot(ray);
  if (!(down > 0)) return;
  const double ahead = prior.forward_c.dot(ray) / down, left = lateral.dot(ray) / down;
  if (std::abs(ahead) > kMaxAhead) return;
  if (ahead * ahead + left * left < kMinDistance * kMinDistance) return;
  const double limit = kOffsetSteps;
  const double first = std::max(std::ceil((left - kBandHalfWidth) / kOffsetStep), -limit);
  const double last = std::min(std::floor((left + kBandHalfWidth) / kOffsetStep), limit);
  for (double k = first; k <= last; ++k) ++(*visible)[static_cast<std::size_t>(k + limit)];
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

LaneRegion::LaneRegion(const RoadPrior& prior, double height, double min_distance, double max_ahead,
                       double half_width)
    : up_(prior.n_c),
      ahead_(prior.forward_c),
      left_(prior.lateral()),
      offset_(prior.region_offset),
      min_distance_(min_distance),
      max_ahead_(max_ahead),
      half_width_(half_width) {
  if (prior.chord && height > 0) {
    chord_length_ = prior.chord->length / height;
    curvature_ = up_.dot(prior.chord->turn_c) / chord_length_;
  }
}

bool LaneRegion::contains(const Eigen::Vector3d& ray) const {
  const double down = -up_.dot(ray);
  if (!(down > 0)) return false;
  const double ahead = ahead_.dot(ray) / down, left = left_.dot(ray) / down;
  if (std::abs(ahead) > max_ahead_) return false;
  if (ahead * ahead + left * left < min_distance_ * min_distance_) return false;
  // Lateral position of the path relative to the chord, not to the tangent at the camera: the
  // parabola of the given curvature through both ends of the chord (ahead = 0 and -chord_length_).
  const double path = 0.5 * curvature_ * ahead * (ahead + chord_length_);
  return std::abs(left - path - offset_) <= half_width_;
}

double visibleRegionOffset(const PinholeCamera& camera, const RoadPrior& prior) {
  Histogram visible{};
  const Eigen::Vector3d lateral = prior.lateral();
  const double step_x = std::max(kRaySpacing * camera.fx, 1.0 * camera.width / kGridSize);
  const double step_y = std::max(kRaySpacing * camera.fy, 1.0 * camera.height / kGridSize);
  for (double y = 0.5 * step_y; y < camera.height; y += step_y) {
    for (double x = 0.5 * step_x; x < camera.width; x += step_x) {
      addRay(prior, lateral, camera.ray({x, y}), &visible);
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
