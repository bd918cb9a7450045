#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace ground_scale_vo {

/// Of two middle values the larger. Precondition: not empty. Changes the order of *values.
inline double median(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

inline double median(std::vector<double> values) { return median(&values); }

/// Of a normal distribution: sigma over the median distance from the median (MAD).
constexpr double kSigmaOfMad = 1.4826;

}  // namespace ground_scale_vo
