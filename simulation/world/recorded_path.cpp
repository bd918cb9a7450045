#include "simulation/world/recorded_path.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "ground_scale_vo/common/error.hpp"

namespace gsv::simulation {
namespace {

constexpr double kHeadingSigma = 1.5;    // of the smoothing of the heading [m]
constexpr double kSlopeSigma = 10;       // of the smoothing of the slope [m]
constexpr double kMotionSigma = 0.3;     // of the smoothing of the speed [s]
constexpr double kVertexSpacing = 1;     // of the positions that define the course, at least [m]
constexpr double kSampleSpacing = 0.25;  // at which heading and slope are smoothed [m]
constexpr double kStandstill = 0.02;     // least advance of a moving car [m]
constexpr double kMinLength = 20, kMaxLength = 12000, kMaxStep = 20;  // [m]
constexpr double kMaxCurvature = 0.3;                                 // [1/m]

/// Convolution with a Gaussian of `sigma` samples.
std::vector<double> smoothed(std::vector<double> values, double sigma) {
  cv::Mat column(values);  // shares the memory of values
  cv::GaussianBlur(column, column, {}, sigma, sigma, cv::BORDER_REFLECT);
  return values;
}

std::vector<double> stepsOf(const std::vector<double>& values) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < values.size(); ++i) steps.push_back(values[i] - values[i - 1]);
  return steps;
}

/// 0, then the sum of the steps up to each.
std::vector<double> sumsOf(const std::vector<double>& steps) {
  std::vector<double> sums{0};
  for (const double step : steps) sums.push_back(sums.back() + step);
  return sums;
}

/// The polygon through positions at least kVertexSpacing apart in the plan, so that the noise of a
/// standstill adds no length.
struct Polygon {
  std::vector<std::size_t> index;         // of the position at each vertex
  std::vector<Eigen::Vector3d> vertices;  // x ahead of the first camera, y left, z up [m]
  std::vector<double> length;             // in the plan, up to each vertex [m]
};

Eigen::Vector3d inRoadAxes(const Eigen::Vector3d& p_c) { return {p_c.z(), -p_c.x(), -p_c.y()}; }

Polygon polygonThrough(const std::vector<Eigen::Vector3d>& positions) {
  Polygon polygon;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const std::string name = "pose " + std::to_string(i + 1);
    if (!positions[i].allFinite()) throw OptionError(name + " is not finite");
    if (i > 0 && (positions[i] - positions[i - 1]).norm() > kMaxStep) {
      throw OptionError(name + " is more than " + std::to_string(static_cast<int>(kMaxStep)) +
                        " m from the one before");
    }
    const Eigen::Vector3d p = inRoadAxes(positions[i]);
    const double step = i == 0 ? 0 : (p - polygon.vertices.back()).head<2>().norm();
    if (i > 0 && step < kVertexSpacing) continue;
    polygon.index.push_back(i);
    polygon.vertices.push_back(p);
    polygon.length.push_back(i == 0 ? 0 : polygon.length.back() + step);
  }
  const double length = polygon.length.empty() ? 0 : polygon.length.back();
  if (length < kMinLength || length > kMaxLength) {
    throw OptionError("has a path of " + std::to_string(static_cast<int>(length)) +
                      " m; a road along it can be 20 m to 12 km long");
  }
  return polygon;
}

/// From each position to the next, along the polygon: between their projections on the edges beside
/// them. Not negative.
std::vector<double> stepsAlong(const Polygon& polygon,
                               const std::vector<Eigen::Vector3d>& positions) {
  std::vector<double> steps;
  double last = 0;
  std::size_t k = 0;  // the edge from vertex k to vertex k + 1
  for (std::size_t i = 1; i < positions.size(); ++i) {
    if (k + 2 < polygon.index.size() && i >= polygon.index[k + 1]) ++k;
    const Eigen::Vector2d a = polygon.vertices[k].head<2>(), b = polygon.vertices[k + 1].head<2>();
    const Eigen::Vector2d p = inRoadAxes(positions[i]).head<2>();
    const double at = polygon.length[k] + (p - a).dot((b - a).normalized());
    steps.push_back(at > last + kStandstill ? at - last : 0);
    last += steps.back();
  }
  return steps;
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
  // Relative to c[1], so that equal control values give exactly their value, as at a standstill.
  return c[1] + (u * u * u * (c[0] - c[1]) + (3 * u * u * u - 6 * u * u + 4) * (c[2] - c[1]) +
                 t * t * t * (c[3] - c[1])) /
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

RecordedPath::RecordedPath(const std::vector<Eigen::Vector3d>& positions, double rate_hz) {
  const Polygon polygon = polygonThrough(positions);
  length_ = polygon.length.back();
  // In the middle of each kSampleSpacing of the polygon [rad], and at its ends [m].
  std::vector<double> headings, elevations;
  for (std::size_t k = 1; k < polygon.vertices.size(); ++k) {
    const Eigen::Vector3d edge = polygon.vertices[k] - polygon.vertices[k - 1];
    const double angle = std::atan2(edge.y(), edge.x()), before = k == 1 ? 0 : headings.back();
    const double heading = before + std::remainder(angle - before, 2 * M_PI);
    const double slope = edge.z() / edge.head<2>().norm();
    while ((static_cast<double>(headings.size()) + 0.5) * kSampleSpacing < polygon.length[k]) {
      headings.push_back(heading);
    }
    while (static_cast<double>(elevations.size()) * kSampleSpacing <= polygon.length[k]) {
      const double at = static_cast<double>(elevations.size()) * kSampleSpacing;
      elevations.push_back(polygon.vertices[k - 1].z() + slope * (at - polygon.length[k - 1]));
    }
  }
  headings = smoothed(std::move(headings), kHeadingSigma / kSampleSpacing);
  // Straight on beyond the ends.
  headings.insert(headings.begin(), headings.front());
  headings.push_back(headings.back());
  heading_ = UniformSpline(-kSampleSpacing / 2, kSampleSpacing, std::move(headings));
  elevation_ = UniformSpline(0, kSampleSpacing,
                             sumsOf(smoothed(stepsOf(elevations), kSlopeSigma / kSampleSpacing)));
  motion_ = UniformSpline(0, 1 / rate_hz,
                          sumsOf(smoothed(stepsAlong(polygon, positions), kMotionSigma * rate_hz)));

  for (std::size_t i = 0; i < positions.size(); ++i) {
    const LongitudinalState state = at(static_cast<double>(i) / rate_hz);
    top_speed_ = std::max(top_speed_, state.v);
    if (std::abs(curvature(state.s)) > kMaxCurvature) {
      throw OptionError("has a curve with a radius below 3.3 m at pose " + std::to_string(i + 1));
    }
  }
}

}  // namespace gsv::simulation
