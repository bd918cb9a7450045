#include "simulation/world/recorded_path.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo::simulation {
namespace {

constexpr double kPlanSigma = 1.5;       // of the smoothing of the plan [m]
constexpr double kElevationSigma = 10;   // of the smoothing of the elevation [m]
constexpr double kMotionSigma = 0.3;     // of the smoothing of s [s]
constexpr double kVertexSpacing = 1;     // of the positions that define the plan, at least [m]
constexpr double kSampleSpacing = 0.25;  // at which the path is smoothed [m]
constexpr double kKnotSpacing = 1;       // of the splines over s [m]
constexpr double kStandstill = 0.02;     // least advance of a moving car [m]
constexpr double kMinLength = 20, kMaxLength = 12000, kMaxStep = 20;  // [m]
constexpr double kMaxCurvature = 0.3;                                 // [1/m]

/// Convolution with a Gaussian of `sigma` samples. Point reflection at both ends keeps a straight
/// line as it is.
std::vector<double> smoothed(const std::vector<double>& values, double sigma) {
  const auto n = static_cast<int>(values.size()), radius = static_cast<int>(std::ceil(4 * sigma));
  const auto at = [&](int i) {
    const auto inside = [&](int k) { return values[static_cast<std::size_t>(k)]; };
    if (i < 0) return 2 * inside(0) - inside(std::min(-i, n - 1));
    if (i >= n) return 2 * inside(n - 1) - inside(std::max(2 * (n - 1) - i, 0));
    return inside(i);
  };
  std::vector<double> weights;
  double sum = 0;
  for (int k = -radius; k <= radius; ++k) {
    weights.push_back(std::exp(-0.5 * k * k / (sigma * sigma)));
    sum += weights.back();
  }
  std::vector<double> result;
  result.reserve(values.size());
  for (int i = 0; i < n; ++i) {
    double value = 0;
    for (int k = -radius; k <= radius; ++k) {
      value += weights[static_cast<std::size_t>(k + radius)] * at(i + k);
    }
    result.push_back(value / sum);
  }
  return result;
}

/// values at the increasing positions x, interpolated linearly at `to`; the first and the last
/// value beyond the ends.
double interpolated(const std::vector<double>& x, const std::vector<double>& values, double to) {
  const auto above = std::upper_bound(x.begin(), x.end(), to);
  if (above == x.begin()) return values.front();
  if (above == x.end()) return values.back();
  const auto k = static_cast<std::size_t>(above - x.begin());
  return values[k - 1] + (values[k] - values[k - 1]) * (to - x[k - 1]) / (x[k] - x[k - 1]);
}

/// The polygon through positions at least kVertexSpacing apart, so that the noise of a standstill
/// adds no length.
struct Polygon {
  std::vector<std::size_t> index;  // of the position at each vertex
  std::vector<double> x, y, z;     // x ahead of the first camera, y left, z up [m]
  std::vector<double> length;      // in the plan, up to each vertex [m]
};

Polygon polygonThrough(const std::vector<Eigen::Vector3d>& positions) {
  Polygon polygon;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Eigen::Vector3d& p = positions[i];
    const std::string name = "pose " + std::to_string(i + 1);
    if (!p.allFinite()) throw OptionError(name + " is not finite");
    if (i > 0 && (p - positions[i - 1]).norm() > kMaxStep) {
      throw OptionError(name + " is more than " + std::to_string(static_cast<int>(kMaxStep)) +
                        " m from the one before");
    }
    const double step =
        i == 0 ? 0 : std::hypot(p.z() - polygon.x.back(), -p.x() - polygon.y.back());
    if (i > 0 && step < kVertexSpacing) continue;
    polygon.length.push_back(i == 0 ? 0 : polygon.length.back() + step);
    polygon.index.push_back(i);
    polygon.x.push_back(p.z());
    polygon.y.push_back(-p.x());
    polygon.z.push_back(-p.y());
  }
  const double length = polygon.length.empty() ? 0 : polygon.length.back();
  if (length < kMinLength || length > kMaxLength) {
    throw OptionError("has a path of " + std::to_string(static_cast<int>(length)) +
                      " m; a road along it can be 20 m to 12 km long");
  }
  return polygon;
}

/// Length along the polygon of each position: its projection on the edge beside it. It does not
/// decrease.
std::vector<double> advance(const std::vector<Eigen::Vector3d>& positions, const Polygon& polygon) {
  std::vector<double> result;
  std::size_t k = 0;  // the edge from vertex k to vertex k + 1
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (k + 2 < polygon.index.size() && i >= polygon.index[k + 1]) ++k;
    const Eigen::Vector2d a(polygon.x[k], polygon.y[k]), b(polygon.x[k + 1], polygon.y[k + 1]);
    const Eigen::Vector2d p(positions[i].z(), -positions[i].x());
    const double at = polygon.length[k] + (p - a).dot((b - a).normalized());
    const double last = result.empty() ? 0 : result.back();
    result.push_back(at > last + kStandstill ? at : last);
  }
  return result;
}

std::vector<double> headings(const std::vector<double>& x, const std::vector<double>& y) {
  std::vector<double> result;
  for (std::size_t k = 1; k < x.size(); ++k) {
    const double angle = std::atan2(y[k] - y[k - 1], x[k] - x[k - 1]);
    result.push_back(
        result.empty() ? angle : result.back() + std::remainder(angle - result.back(), 2 * M_PI));
  }
  return result;
}

}  // namespace

UniformSpline::UniformSpline(double start, double step, std::vector<double> values)
    : start_(start), step_(step), values_(std::move(values)) {}

UniformSpline::Span UniformSpline::spanAt(double x) const {
  const auto n = static_cast<double>(values_.size());
  const double at = (x - start_) / step_, first = std::floor(at);
  Span span{at - first, {}};
  for (int k = 0; k < 4; ++k) {
    const double i = first + k - 1, inside = std::clamp(i, 0.0, n - 1);
    const auto index = static_cast<std::size_t>(inside);
    const double slope =
        i < 0 ? values_[1] - values_[0] : values_.back() - values_[values_.size() - 2];
    span.c[k] = values_[index] + (i - inside) * slope;
  }
  return span;
}

double UniformSpline::value(double x) const {
  const auto [t, c] = spanAt(x);
  const double u = 1 - t;
  return (u * u * u * c[0] + (3 * t * t * t - 6 * t * t + 4) * c[1] +
          (3 * u * u * u - 6 * u * u + 4) * c[2] + t * t * t * c[3]) /
         6;
}

double UniformSpline::derivative(double x) const {
  const auto [t, c] = spanAt(x);
  const double u = 1 - t;
  return (u * u / 2 * (c[1] - c[0]) + (0.5 + t * u) * (c[2] - c[1]) + t * t / 2 * (c[3] - c[2])) /
         step_;
}

double UniformSpline::secondDerivative(double x) const {
  const auto [t, c] = spanAt(x);
  return ((1 - t) * (c[2] - 2 * c[1] + c[0]) + t * (c[3] - 2 * c[2] + c[1])) / (step_ * step_);
}

RecordedPath::RecordedPath(const std::vector<Eigen::Vector3d>& positions, double rate_hz)
    : RecordedPath(fit(positions, rate_hz), positions.size(), rate_hz) {}

RecordedPath::RecordedPath(Course course, std::size_t positions, double rate_hz)
    : heading_(std::move(course.heading)),
      elevation_(std::move(course.elevation)),
      motion_(std::move(course.motion)),
      length_(course.length) {
  for (std::size_t i = 0; i < positions; ++i) {
    const LongitudinalState state = at(static_cast<double>(i) / rate_hz);
    top_speed_ = std::max(top_speed_, state.v);
    if (std::abs(curvature(state.s)) > kMaxCurvature) {
      throw OptionError("has a curve with a radius below 3.3 m at pose " + std::to_string(i + 1));
    }
  }
}

RecordedPath::Course RecordedPath::fit(const std::vector<Eigen::Vector3d>& positions,
                                       double rate_hz) {
  const Polygon polygon = polygonThrough(positions);
  std::vector<double> along, x, y, z;  // samples of the polygon
  for (double at = 0; at <= polygon.length.back(); at += kSampleSpacing) {
    along.push_back(at);
    x.push_back(interpolated(polygon.length, polygon.x, at));
    y.push_back(interpolated(polygon.length, polygon.y, at));
    z.push_back(interpolated(polygon.length, polygon.z, at));
  }
  x = smoothed(x, kPlanSigma / kSampleSpacing);
  y = smoothed(y, kPlanSigma / kSampleSpacing);
  z = smoothed(z, kElevationSigma / kSampleSpacing);

  std::vector<double> s{0};
  for (std::size_t k = 1; k < x.size(); ++k) {
    s.push_back(s.back() + std::hypot(x[k] - x[k - 1], y[k] - y[k - 1]));
  }
  std::vector<double> knot_x, knot_y, knot_z;
  for (double at = 0; at <= s.back(); at += kKnotSpacing) {
    knot_x.push_back(interpolated(s, x, at));
    knot_y.push_back(interpolated(s, y, at));
    knot_z.push_back(interpolated(s, z, at));
  }
  std::vector<double> heading = headings(knot_x, knot_y);
  // Straight on beyond the ends.
  heading.insert(heading.begin(), heading.front());
  heading.push_back(heading.back());

  std::vector<double> motion;
  for (const double at : advance(positions, polygon)) {
    const double beyond = std::max(at - along.back(), 0.0);
    motion.push_back(interpolated(along, s, at) + beyond);
  }
  return {UniformSpline(-kKnotSpacing / 2, kKnotSpacing, std::move(heading)),
          UniformSpline(0, kKnotSpacing, std::move(knot_z)),
          UniformSpline(0, 1 / rate_hz, smoothed(motion, kMotionSigma * rate_hz)), s.back()};
}

}  // namespace ground_scale_vo::simulation
