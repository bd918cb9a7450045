#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

namespace ground_scale_vo {

/// Counts warnings by kind and lets one message of a kind through every few seconds of wall time
/// (not ROS time: the clock of a bag may stop or jump).
class WarningLog {
 public:
  explicit WarningLog(std::chrono::milliseconds interval = std::chrono::seconds(5))
      : interval_(interval) {}

  /// Counts one warning. kind: a short name such as "image refused", which begins with what is
  /// affected. Returns the sentence with the count so far if it is due for printing, else an empty
  /// string.
  std::string count(const std::string& kind, const std::string& sentence);

  /// By kind, since construction.
  std::map<std::string, std::uint64_t> counts() const;
  /// Sum over the kinds whose name begins with this text: "image " covers "image refused" and
  /// "image stamp".
  std::uint64_t total(const std::string& prefix) const;

 private:
  struct Kind {
    std::uint64_t count = 0;
    std::chrono::steady_clock::time_point printed{};
  };
  const std::chrono::milliseconds interval_;
  std::map<std::string, Kind> kinds_;
};

}  // namespace ground_scale_vo
