#include "ground_scale_vo/ros/fault_log.hpp"

namespace ground_scale_vo {

std::string FaultLog::report(const std::string& kind, const std::string& sentence) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Kind& entry = kinds_[kind];
  ++entry.count;
  const auto now = std::chrono::steady_clock::now();
  if (entry.count > 1 && now - entry.printed < interval_) return {};
  entry.printed = now;
  return sentence + " (" + kind + ": " + std::to_string(entry.count) + " so far)";
}

std::map<std::string, std::uint64_t> FaultLog::counts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::map<std::string, std::uint64_t> counts;
  for (const auto& [kind, entry] : kinds_) counts[kind] = entry.count;
  return counts;
}

std::uint64_t FaultLog::count(const std::string& beginning) const {
  std::uint64_t sum = 0;
  for (const auto& [kind, count] : counts()) {
    if (kind.compare(0, beginning.size(), beginning) == 0) sum += count;
  }
  return sum;
}

}  // namespace ground_scale_vo
