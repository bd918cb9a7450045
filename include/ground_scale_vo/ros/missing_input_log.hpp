#pragma once

#include <ros/time.h>

#include <chrono>
#include <map>
#include <optional>
#include <string>

#include "ground_scale_vo/ros/diagnostic_summary.hpp"

namespace ground_scale_vo {

/// Decides when the log warns of missing input: 5 s after it was first missing, or, if it was
/// received before, when the diagnostics report it; then every 30 s of wall time.
class MissingInputLog {
 public:
  using Clock = std::chrono::steady_clock;

  /// Call it with every diagnosis. clock_runs: ROS time has advanced since the last call. While it
  /// stands still, because a bag is paused or has ended, silence of an input is not reported.
  /// Returns the sentence if it is due, else an empty string.
  std::string due(const std::optional<MissingInput>& missing, bool clock_runs,
                  Clock::time_point now);
  /// The same at the current wall time. ros_now: from which it derives whether the clock runs.
  std::string due(const std::optional<MissingInput>& missing, const ros::Time& ros_now);

 private:
  ros::Time last_ros_time_;
  std::string input_;  ///< missing since since_; empty: none
  Clock::time_point since_{};
  std::map<std::string, Clock::time_point> printed_;  ///< by input
};

}  // namespace ground_scale_vo
