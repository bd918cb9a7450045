#pragma once

#include <chrono>

namespace ground_scale_vo {

/// Wall time since construction or the last lap.
class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  double ms() const { return 1e3 * seconds(); }
  /// ms(), and starts the next lap.
  double lapMs() {
    const Clock::time_point now = Clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
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

}  // namespace ground_scale_vo
