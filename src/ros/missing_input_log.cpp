#include "ground_scale_vo/ros/missing_input_log.hpp"

#include <utility>

namespace ground_scale_vo {
namespace {

constexpr std::chrono::seconds kStartup(5);  // a driver may start after the nodelets
constexpr std::chrono::seconds kPeriod(30);

}  // namespace

std::string MissingInputLog::due(const std::optional<MissingInput>& missing, bool clock_runs,
                                 Clock::time_point now) {
  const std::string input = missing ? missing->input : "";
  if (input != input_) {
    input_ = input;
    since_ = now;
  }
  if (!missing) return {};
  if (missing->was_received ? !clock_runs : now - since_ < kStartup) return {};
  const auto printed = printed_.find(input);
  if (printed != printed_.end() && now - printed->second < kPeriod) return {};
  printed_[input] = now;
  return missing->sentence;
}

std::string MissingInputLog::due(const std::optional<MissingInput>& missing,
                                 const ros::Time& ros_now) {
  const bool clock_runs = ros_now != std::exchange(last_ros_time_, ros_now);
  return due(missing, clock_runs, Clock::now());
}

}  // namespace ground_scale_vo
