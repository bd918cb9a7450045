#pragma once

#include <cstdint>

#include "ground_scale_vo/common/stopwatch.hpp"

namespace ground_scale_vo {

/// How often a second something happens, between two looks at its count.
class RateMeter {
 public:
  /// count: so far. Returns the rate since the last call or the construction [Hz].
  double rate(std::uint64_t count) {
    const double seconds = 1e-3 * watch_.lapMs();
    const auto more = static_cast<double>(count - count_);
    count_ = count;
    return seconds > 0 ? more / seconds : 0.0;
  }

 private:
  Stopwatch watch_;
  std::uint64_t count_ = 0;
};

}  // namespace ground_scale_vo
