#include "ground_scale_vo/ros/stamp_guard.hpp"

#include <sstream>

namespace ground_scale_vo {

StampGuard::Verdict StampGuard::check(const ros::Time& stamp) {
  if (stamp.isZero()) {
    reason_ = "the stamp is zero";
    return Verdict::kDrop;
  }
  if (stamp > last_) {
    last_ = stamp;
    return Verdict::kNext;
  }
  if ((last_ - stamp).toSec() > clock_jump_s_) {
    last_ = stamp;
    return Verdict::kJumpedBack;
  }
  std::ostringstream sentence;
  sentence << "the stamp " << stamp << " does not lie after the last one, " << last_;
  reason_ = sentence.str();
  return Verdict::kDrop;
}

}  // namespace ground_scale_vo
