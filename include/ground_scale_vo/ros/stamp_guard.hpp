#pragma once

#include <ros/time.h>

#include <string>

namespace ground_scale_vo {

/// The rule for the stamps of a stream of images, the same in both nodelets.
class StampGuard {
 public:
  enum class Verdict {
    kNext,       ///< later than all before: use it
    kDrop,       ///< zero, repeated or a little backward: leave it out
    kJumpedBack  ///< the clock jumped back (a looped bag): start anew with it
  };

  /// clock_jump_s: a stamp that lies farther back than this [s] is a jump of the clock.
  explicit StampGuard(double clock_jump_s) : clock_jump_s_(clock_jump_s) {}

  Verdict check(const ros::Time& stamp);
  /// Why the last check() said kDrop; one sentence.
  const std::string& reason() const { return reason_; }

 private:
  const double clock_jump_s_;
  ros::Time last_;
  std::string reason_;
};

}  // namespace ground_scale_vo
