#include "synthetic_street.hpp"

#include <algorithm>
#include <cmath>

namespace ground_scale_vo::synthetic {
namespace {

constexpr double kPeriod = 130;  // the road repeats itself [m]
constexpr double kStep = 0.5;    // of the nodes [m]
constexpr double kEdge = 6;      // over which a ramp begins and ends [m]

/// A smooth hump sin^2 over [a, b], and its integral.
double hump(double s, double a, double b) {
  const double x = std::clamp((s - a) / (b - a), 0.0, 1.0);
  return std::pow(std::sin(kPi * x), 2);
}
double humpIntegral(double s, double a, double b) {
  const double x = std::clamp((s - a) / (b - a), 0.0, 1.0);
  return (b - a) * (x - std::sin(2 * kPi * x) / (2 * kPi)) / 2;
}
double inPeriod(double s) { return s - kPeriod * std::floor(s / kPeriod); }

/// From 0 to 1 over [a, a + kEdge] with a smooth start and end, and its integral.
double step(double s, double a) {
  const double x = std::clamp((s - a) / kEdge, 0.0, 1.0);
  return x - std::sin(2 * kPi * x) / (2 * kPi);
}
double stepIntegral(double s, double a) {
  const double x = std::clamp((s - a) / kEdge, 0.0, 1.0);
  return kEdge * (x * x / 2 + (std::cos(2 * kPi * x) - 1) / (4 * kPi * kPi)) +
         std::max(0.0, s - a - kEdge);
}

/// Place on the nearest bump, from 0 to 1; outside of it beside a bump.
double onBump(double s) {
  const double k = std::max(0.0, std::round((s - kBumpAt - kBumpLength / 2) / kBumpSpacing));
  return (s - kBumpAt - k * kBumpSpacing) / kBumpLength;
}

}  // namespace

std::uint64_t Random::bits() {
  state_ += 0x9E3779B97F4A7C15u;
  std::uint64_t z = state_;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  return z ^ (z >> 31);
}

double Random::uniform(double from, double to) {
  return from + (to - from) * static_cast<double>(bits() >> 11) * 0x1p-53;
}

Street::Street(const RoadShape& shape, double from, double to)
    : shape_(shape), from_(from), to_(to), nodes_{{from, 0}} {
  for (double s = from; s < to; s = from + kStep * static_cast<double>(nodes_.size() - 1)) {
    const double a = heading(s), m = heading(s + kStep / 2), b = heading(s + kStep);  // Simpson
    nodes_.push_back(nodes_.back() +
                     kStep / 6 *
                         Eigen::Vector2d(std::cos(a) + 4 * std::cos(m) + std::cos(b),
                                         std::sin(a) + 4 * std::sin(m) + std::sin(b)));
  }
}

double Street::curvature(double s) const {
  const double at = inPeriod(s);
  return shape_.curvature * (hump(at, 15, 55) - hump(at, 65, 105));
}
double Street::heading(double s) const {
  const double at = inPeriod(s);
  return shape_.curvature * (humpIntegral(at, 15, 55) - humpIntegral(at, 65, 105));
}
double Street::rise(double s) const {
  const double at = inPeriod(s);
  double rise = shape_.slope * (hump(at, 0, 65) - hump(at, 65, 130));
  if (shape_.ramp_slope != 0) {
    rise += shape_.ramp_slope * (step(s, shape_.ramp_from) - step(s, shape_.ramp_to - kEdge));
  }
  if (shape_.bump_height > 0) {
    const double x = onBump(s);
    if (x > 0 && x < 1) rise += shape_.bump_height * kPi / kBumpLength * std::sin(2 * kPi * x);
  }
  return rise;
}
double Street::elevation(double s) const {
  const double at = inPeriod(s);
  double height = shape_.slope * (humpIntegral(at, 0, 65) - humpIntegral(at, 65, 130));
  if (shape_.ramp_slope != 0) {
    height += shape_.ramp_slope *
              (stepIntegral(s, shape_.ramp_from) - stepIntegral(s, shape_.ramp_to - kEdge));
  }
  if (shape_.bump_height > 0) height += shape_.bump_height * hump(onBump(s), 0, 1);
  return height;
}

double Street::lowest() const {
  double lowest = elevation(from_);
  for (double s = from_; s < to_; s += kStep) lowest = std::min(lowest, elevation(s));
  return lowest;
}

double Street::distance(const Eigen::Vector3d& p) const {
  double squared = 1e18;
  for (const Eigen::Vector2d& node : nodes_) {
    squared = std::min(squared, (node - p.head<2>()).squaredNorm());
  }
  return std::sqrt(squared);
}

Eigen::Vector3d Street::point(double s, double u, double z) const {
  const auto node = static_cast<std::size_t>(
      std::clamp((s - from_) / kStep, 0.0, static_cast<double>(nodes_.size()) - 1));
  const double start = from_ + kStep * static_cast<double>(node), h = s - start;
  const double a = heading(start), m = heading(start + h / 2), b = heading(s);
  const Eigen::Vector2d plan =
      nodes_[node] + h / 6 *
                         Eigen::Vector2d(std::cos(a) + 4 * std::cos(m) + std::cos(b),
                                         std::sin(a) + 4 * std::sin(m) + std::sin(b));
  return {plan.x() - u * std::sin(b), plan.y() + u * std::cos(b), elevation(s) + z};
}

Eigen::Isometry3d Street::frame(double s, double u) const {
  const double angle = heading(s), up = rise(s) / (1 - u * curvature(s));
  Eigen::Isometry3d T_w_s = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d x = Eigen::Vector3d(std::cos(angle), std::sin(angle), up).normalized();
  const Eigen::Vector3d y(-std::sin(angle), std::cos(angle), 0);
  T_w_s.linear() << x, y, x.cross(y);
  T_w_s.translation() = point(s, u);
  return T_w_s;
}

}  // namespace ground_scale_vo::synthetic
