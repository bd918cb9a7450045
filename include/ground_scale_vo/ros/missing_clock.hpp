#pragma once

#include <ros/time.h>

#include <string>

namespace ground_scale_vo {

/// That ROS time does not run, in one clause; empty: it does. Drivers then stamp their images with
/// zero, or wait for the time.
inline std::string missingClock() {
  if (!ros::Time::isSimTime() || !ros::Time::now().isZero()) return {};
  return "/use_sim_time is true, but no time was received on /clock: publish it, or for a live "
         "camera set /use_sim_time to false and restart all nodes";
}

/// The sentence, followed by missingClock().
inline std::string withMissingClock(const std::string& sentence) {
  const std::string missing = missingClock();
  return missing.empty() ? sentence : sentence + "; " + missing;
}

}  // namespace ground_scale_vo
