#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace ground_scale_vo {

/// Of an even number of values the upper median. Precondition: not empty. Reorders *values.
inline double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

inline double median(std::vector<double> values) { return median(&values); }

/// Standard deviation of a normal distribution over its median absolute deviation (MAD).
constexpr double kSigmaOfMad = 1.4826;

}  // namespace ground_scale_vo
