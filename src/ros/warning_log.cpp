#include "ground_scale_vo/ros/warning_log.hpp"

namespace ground_scale_vo {

std::string WarningLog::count(const std::string& kind, const std::string& sentence) {
  Kind& entry = kinds_[kind];
  ++entry.count;
  const auto now = std::chrono::steady_clock::now();
  if (entry.count > 1 && now - entry.printed < interval_) return {};
  entry.printed = now;
  return sentence + " (" + kind + ": " + std::to_string(entry.count) + " so far)";
}

std::map<std::string, std::uint64_t> WarningLog::counts() const {
  std::map<std::string, std::uint64_t> counts;
  for (const auto& [kind, entry] : kinds_) counts[kind] = entry.count;
  return counts;
}

std::uint64_t WarningLog::total(const std::string& prefix) const {
  std::uint64_t sum = 0;
  for (const auto& [kind, entry] : kinds_) {
    if (kind.compare(0, prefix.size(), prefix) == 0) sum += entry.count;
  }
  return sum;
}

}  // namespace ground_scale_vo
