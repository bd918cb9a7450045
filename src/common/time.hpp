#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "common/text.hpp"

namespace gsv {

/// The latest stamp that ROS can represent, in the year 2106 [s].
constexpr double kLatestStamp = 4294967295;

/// [s] from one stamp [ns] to another; negative when `to_ns` is the earlier one.
inline double secondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}

/// Whether two consecutive intervals are so unequal that the velocity over both counts: images in
/// pairs have stamps with too short and too long intervals in turn.
inline bool areUnequal(double dt_a, double dt_b) { return std::max(dt_a / dt_b, dt_b / dt_a) > 2; }

/// Stamp [ns] of image i of images at a constant rate [Hz], from 0 on.
inline std::int64_t stampAtRate(std::size_t i, double rate_hz) {
  return std::llround(1e9 * static_cast<double>(i) / rate_hz);
}

/// Seconds with nine decimals.
inline std::string formatSeconds(std::int64_t stamp_ns) {
  constexpr std::int64_t kSecond = 1000000000;
  return format("%s%lld.%09lld", stamp_ns < 0 ? "-" : "",
                static_cast<long long>(std::abs(stamp_ns / kSecond)),
                static_cast<long long>(std::abs(stamp_ns % kSecond)));
}

/// Wall time since construction or the last lap.
class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  double ms() const { return 1e3 * seconds(); }
  /// ms(), and starts the next lap.
  double lapMs() {
    const double lap = ms();
    start_ = Clock::now();
    return lap;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

/// Adds its lifetime [ms] to *ms.
class ScopedTimer {
 public:
  explicit ScopedTimer(double* ms) : ms_(ms) {}
  ~ScopedTimer() { *ms_ += watch_.ms(); }
  ScopedTimer(const ScopedTimer&) = delete;
  ScopedTimer& operator=(const ScopedTimer&) = delete;

 private:
  double* ms_;
  const Stopwatch watch_;
};

}  // namespace gsv
