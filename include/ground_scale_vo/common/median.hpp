#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace ground_scale_vo {

/// Median; the upper one for an even number of values. Precondition: not empty. Reorders *values.
inline double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

inline double median(std::vector<double> values) { return median(&values); }

/// Ratio sigma / MAD (median absolute deviation) for normally distributed data.
constexpr double kMadToSigma = 1.4826;

}  // namespace ground_scale_vo
