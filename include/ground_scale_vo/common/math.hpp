#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace gsv {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegreesPerRadian = 180 / kPi;
constexpr double kRadiansPerDegree = kPi / 180;

/// Median; the upper one for an even number of values. Precondition: not empty. Reorders *values.
inline double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}
inline double median(std::vector<double> values) { return median(&values); }

/// Ratio sigma / MAD (median absolute deviation) for normally distributed data.
constexpr double kMadToSigma = 1.4826;

// isFinite() of a number, a matrix, a pose, or a container of numbers: the check of every input and
// result of a class.

inline bool isFinite(double value) { return std::isfinite(value); }
template <typename Derived>
bool isFinite(const Eigen::MatrixBase<Derived>& values) {
  return values.allFinite();
}
inline bool isFinite(const Eigen::Isometry3d& T) { return T.matrix().allFinite(); }
template <typename Range>
auto isFinite(const Range& values)
    -> std::enable_if_t<std::is_arithmetic_v<typename Range::value_type> &&
                            !std::is_base_of_v<Eigen::EigenBase<Range>, Range>,
                        bool> {
  return std::all_of(values.begin(), values.end(),
                     [](auto value) { return isFinite(static_cast<double>(value)); });
}
template <typename... Values>
bool areFinite(const Values&... values) {
  return (isFinite(values) && ...);
}

/// Largest magnitude of a plausible coordinate, in any unit: fits a 32-bit integer, and a float
/// still resolves it to 64 units.
constexpr double kLargestCoordinate = 1e9;

/// Whether all coordinates are finite and at most kLargestCoordinate.
template <typename Derived>
bool isPlausiblePosition(const Eigen::MatrixBase<Derived>& coordinates) {
  return (coordinates.array().abs() <= static_cast<typename Derived::Scalar>(kLargestCoordinate))
      .all();
}

}  // namespace gsv
