#include "synthetic_street.hpp"

#include <algorithm>
#include <cmath>

namespace ground_scale_vo::synthetic {
namespace {

constexpr double kPeriod = 130;  // the road repeats itself [m]
constexpr double kStep = 0.5;    // of the nodes [m]

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

Street::Street(double curvature, double slope, double from, double to)
    : curvature_(curvature), slope_(slope), from_(from), to_(to), nodes_{{from, 0}} {
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
  return curvature_ * (hump(at, 15, 55) - hump(at, 65, 105));
}
double Street::heading(double s) const {
  const double at = inPeriod(s);
  return curvature_ * (humpIntegral(at, 15, 55) - humpIntegral(at, 65, 105));
}
double Street::rise(double s) const {
  const double at = inPeriod(s);
  return slope_ * (hump(at, 0, 65) - hump(at, 65, 130));
}
double Street::elevation(double s) const {
  const double at = inPeriod(s);
  return slope_ * (humpIntegral(at, 0, 65) - humpIntegral(at, 65, 130));
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
