#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace ground_scale_vo {

/// Counts faults by kind, and lets one message of a kind through every few seconds of wall time
/// (not ROS time: a bag's clock may stand still or jump). Thread safe.
class FaultLog {
 public:
  explicit FaultLog(std::chrono::milliseconds interval = std::chrono::seconds(5))
      : interval_(interval) {}

  /// The sentence with the count so far when it is time to print one, else empty.
  std::string report(const std::string& kind, const std::string& sentence);

  /// By kind, since construction.
  std::map<std::string, std::uint64_t> counts() const;
  /// Of the kinds that begin so, together.
  std::uint64_t count(const std::string& beginning) const;

 private:
  struct Kind {
    std::uint64_t count = 0;
    std::chrono::steady_clock::time_point printed{};
  };
  const std::chrono::milliseconds interval_;
  mutable std::mutex mutex_;
  std::map<std::string, Kind> kinds_;
};

}  // namespace ground_scale_vo
