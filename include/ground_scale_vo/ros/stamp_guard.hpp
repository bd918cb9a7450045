#pragma once

#include <ros/time.h>

#include <cstdint>
#include <string>

namespace ground_scale_vo {

/// Checks the stamps of a stream of messages: of the images in MonoVo, of vo/frame in
/// ScaleRecovery.
///
/// A stamp far ahead is dropped. The next one is accepted if it continues from there, as after a
/// pause. A single one is a fault: accepting it would put all later images in the past, for tf
/// listeners too.
class StampGuard {
 public:
  enum class Verdict {
    kAccept,     ///< later than the last accepted one
    kDrop,       ///< zero, (nearly) repeated, slightly backward, or far ahead
    kJumpedBack  ///< the clock jumped back, as in a looped bag: reset and process the message
  };

  /// clock_jump_s: a stamp that is earlier by more than this [s] is a jump of the clock.
  explicit StampGuard(double clock_jump_s) : clock_jump_s_(clock_jump_s) {}

  /// Shortest interval between two stamps [s]; a shorter one gives no meaningful velocity.
  static constexpr double kMinStep = 0.001;
  /// Longest step forward that is accepted at once [s].
  static constexpr double kMaxAhead = 3600.0;

  Verdict check(const ros::Time& stamp);
  /// One sentence: why the last check() returned kDrop.
  const std::string& reason() const { return reason_; }

 private:
  const double clock_jump_s_;
  std::int64_t last_ns_ = 0;   ///< last accepted stamp; 0: none
  std::int64_t ahead_ns_ = 0;  ///< pending stamp far ahead; 0: none
  std::string reason_;
};

}  // namespace ground_scale_vo
