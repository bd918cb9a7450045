#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <type_traits>

namespace ground_scale_vo {

// The rule for numbers that cross the border of a class: isFinite() of a number, a matrix, a pose,
// or a container of numbers.

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

/// Coordinates beyond this, in whatever unit, are no place that a camera can be at or see: from
/// here on squares and sums of a float lose their meaning, and whole numbers do not hold them.
constexpr double kLargestCoordinate = 1e9;

/// Every coordinate is finite and plausible.
template <typename Derived>
bool isPlace(const Eigen::MatrixBase<Derived>& coordinates) {
  return (coordinates.array().abs() <= static_cast<typename Derived::Scalar>(kLargestCoordinate))
      .all();
}

}  // namespace ground_scale_vo
