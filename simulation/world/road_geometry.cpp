#include "simulation/world/road_geometry.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace gsv::simulation {
namespace {

constexpr double kNodeSpacing = 0.5;   // [m]
constexpr double kOwnStretch = 20;     // of a lane beside a point, in each direction [m]
constexpr double kRampTransition = 6;  // over which the slope of the ramp changes [m]

// Curves and long waves of the road repeat after kPeriod; positions in the period [m].
constexpr double kPeriod = 130;
constexpr double kLeftCurveBegin = 15, kLeftCurveEnd = 55;
constexpr double kRightCurveBegin = 65, kRightCurveEnd = 105;
constexpr double kUphillEnd = 65;

/// sin^2 over [a, b], 0 elsewhere, and its integral.
double hump(double s, double a, double b) {
  const double x = std::clamp((s - a) / (b - a), 0.0, 1.0);
  return std::pow(std::sin(M_PI * x), 2);
}
double humpIntegral(double s, double a, double b) {
  const double x = std::clamp((s - a) / (b - a), 0.0, 1.0);
  return (b - a) * (x - std::sin(2 * M_PI * x) / (2 * M_PI)) / 2;
}
double withinPeriod(double s) { return s - kPeriod * std::floor(s / kPeriod); }

/// Smooth step from 0 to 1 over [a, a + kRampTransition], and its integral.
double rampStep(double s, double a) {
  const double x = std::clamp((s - a) / kRampTransition, 0.0, 1.0);
  return x - std::sin(2 * M_PI * x) / (2 * M_PI);
}
double rampStepIntegral(double s, double a) {
  const double x = std::clamp((s - a) / kRampTransition, 0.0, 1.0);
  return kRampTransition * (x * x / 2 + (std::cos(2 * M_PI * x) - 1) / (4 * M_PI * M_PI)) +
         std::max(0.0, s - a - kRampTransition);
}

/// Position relative to the nearest bump: 0 at its begin, 1 at its end, outside [0, 1] off the
/// bump.
double bumpCoordinate(double s) {
  const double k = std::max(0.0, std::round((s - kFirstBump - kBumpLength / 2) / kBumpSpacing));
  return (s - kFirstBump - k * kBumpSpacing) / kBumpLength;
}

}  // namespace

RoadGeometry::RoadGeometry(const SyntheticDrive::Options& options,
                           std::shared_ptr<const RecordedPath> path, double s_begin, double s_end)
    : options_(options),
      path_(std::move(path)),
      s_begin_(s_begin),
      s_end_(s_end),
      nodes_{{s_begin, 0}} {
  // The plan positions integrate (cos, sin) of the heading with Simpson's rule.
  for (double s = s_begin; s < s_end;
       s = s_begin + kNodeSpacing * static_cast<double>(nodes_.size() - 1)) {
    const double a = heading(s), m = heading(s + kNodeSpacing / 2), b = heading(s + kNodeSpacing);
    nodes_.push_back(nodes_.back() +
                     kNodeSpacing / 6 *
                         Eigen::Vector2d(std::cos(a) + 4 * std::cos(m) + std::cos(b),
                                         std::sin(a) + 4 * std::sin(m) + std::sin(b)));
  }
}

double RoadGeometry::curvature(double s) const {
  if (path_) return path_->curvature(s);
  const double at = withinPeriod(s + options_.road_shift_m);
  return options_.curvature *
         (hump(at, kLeftCurveBegin, kLeftCurveEnd) - hump(at, kRightCurveBegin, kRightCurveEnd));
}
double RoadGeometry::heading(double s) const { return turned(s) - turned(0); }
double RoadGeometry::turned(double s) const {
  if (path_) return path_->heading(s);
  const double at = withinPeriod(s + options_.road_shift_m);
  return options_.curvature * (humpIntegral(at, kLeftCurveBegin, kLeftCurveEnd) -
                               humpIntegral(at, kRightCurveBegin, kRightCurveEnd));
}
double RoadGeometry::slope(double s) const {
  if (path_) return path_->slope(s);
  const double at = withinPeriod(s + options_.road_shift_m);
  double slope = options_.slope * (hump(at, 0, kUphillEnd) - hump(at, kUphillEnd, kPeriod));
  if (options_.ramp_slope != 0) {
    slope += options_.ramp_slope * (rampStep(s, options_.ramp.from_m) -
                                    rampStep(s, options_.ramp.to_m - kRampTransition));
  }
  if (options_.bump_height > 0) {
    const double x = bumpCoordinate(s);
    if (x > 0 && x < 1) slope += options_.bump_height * M_PI / kBumpLength * std::sin(2 * M_PI * x);
  }
  return slope;
}
double RoadGeometry::elevation(double s) const {
  if (path_) return path_->elevation(s);
  const double at = withinPeriod(s + options_.road_shift_m);
  double height =
      options_.slope * (humpIntegral(at, 0, kUphillEnd) - humpIntegral(at, kUphillEnd, kPeriod));
  if (options_.ramp_slope != 0) {
    height += options_.ramp_slope * (rampStepIntegral(s, options_.ramp.from_m) -
                                     rampStepIntegral(s, options_.ramp.to_m - kRampTransition));
  }
  if (options_.bump_height > 0) height += options_.bump_height * hump(bumpCoordinate(s), 0, 1);
  return height;
}

double RoadGeometry::lowestElevation() const {
  double lowest = elevation(s_begin_);
  for (double s = s_begin_; s < s_end_; s += kNodeSpacing) lowest = std::min(lowest, elevation(s));
  return lowest;
}

bool RoadGeometry::isInSection(double s, double camera_s) const {
  return !path_ || (s > camera_s - kSectionBehind && s < camera_s + kSectionAhead);
}

/// From p to the nearest node with s in [s_from, s_to].
double RoadGeometry::squaredDistance(const Eigen::Vector3d& p, double s_from, double s_to) const {
  const auto index = [&](double s) {
    const double node = std::ceil((s - s_begin_) / kNodeSpacing);
    return static_cast<std::size_t>(std::clamp(node, 0.0, static_cast<double>(nodes_.size())));
  };
  double squared = std::numeric_limits<double>::infinity();
  for (std::size_t k = index(s_from); k < index(s_to); ++k) {
    squared = std::min(squared, (nodes_[k] - p.head<2>()).squaredNorm());
  }
  return squared;
}

double RoadGeometry::distanceToLane(double s, const Eigen::Vector3d& p) const {
  constexpr double kAll = std::numeric_limits<double>::max();
  const double section = path_ ? kSectionBehind + kSectionAhead : kAll;
  return std::sqrt(squaredDistance(p, s - section, s + section));
}

double RoadGeometry::distanceToOtherLanes(double s, const Eigen::Vector3d& p) const {
  if (!path_) return std::numeric_limits<double>::infinity();
  constexpr double kSection = kSectionBehind + kSectionAhead;
  return std::sqrt(std::min(squaredDistance(p, s - kSection, s - kOwnStretch),
                            squaredDistance(p, s + kOwnStretch, s + kSection)));
}

Eigen::Vector3d RoadGeometry::surfacePoint(double s, double u, double z) const {
  const auto node = static_cast<std::size_t>(
      std::clamp((s - s_begin_) / kNodeSpacing, 0.0, static_cast<double>(nodes_.size()) - 1));
  const double start = s_begin_ + kNodeSpacing * static_cast<double>(node), h = s - start;
  const double a = heading(start), m = heading(start + h / 2), b = heading(s);
  const Eigen::Vector2d plan =
      nodes_[node] + h / 6 *
                         Eigen::Vector2d(std::cos(a) + 4 * std::cos(m) + std::cos(b),
                                         std::sin(a) + 4 * std::sin(m) + std::sin(b));
  return {plan.x() - u * std::sin(b), plan.y() + u * std::cos(b), elevation(s) + z};
}

Eigen::Isometry3d RoadGeometry::surfaceFrame(double s, double u) const {
  const double angle = heading(s), up = slope(s) / (1 - u * curvature(s));
  Eigen::Isometry3d T_w_s = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d x = Eigen::Vector3d(std::cos(angle), std::sin(angle), up).normalized();
  const Eigen::Vector3d y(-std::sin(angle), std::cos(angle), 0);
  T_w_s.linear() << x, y, x.cross(y);
  T_w_s.translation() = surfacePoint(s, u);
  return T_w_s;
}

}  // namespace gsv::simulation
