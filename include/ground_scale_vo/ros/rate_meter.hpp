#pragma once

#include <cstdint>

#include "ground_scale_vo/common/stopwatch.hpp"

namespace ground_scale_vo {

/// Rate at which a counter increases.
class RateMeter {
 public:
  /// Mean rate since the last call, or since construction [Hz].
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
