#pragma once

#include <chrono>
#include <cstdint>

namespace ground_scale_vo {

/// Rate at which a counter increases.
class RateMeter {
 public:
  using Clock = std::chrono::steady_clock;

  explicit RateMeter(Clock::time_point now = Clock::now()) : last_(now) {}

  /// Mean rate since the last call, or since construction [Hz].
  double rate(std::uint64_t count, Clock::time_point now = Clock::now()) {
    const double seconds = std::chrono::duration<double>(now - last_).count();
    const auto more = static_cast<double>(count - count_);
    last_ = now;
    count_ = count;
    return seconds > 0 ? more / seconds : 0.0;
  }

 private:
  Clock::time_point last_;
  std::uint64_t count_ = 0;
};

}  // namespace ground_scale_vo
