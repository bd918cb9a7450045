#pragma once

#include <ros/time.h>

#include <cstdint>
#include <string>

namespace ground_scale_vo {

/// The rule for the stamps of a stream of images, the same in both nodelets.
///
/// A stamp far ahead is believed when the next one follows it: a pause. Alone it is a fault, which
/// would make all that come after it lie in the past, for tf's listeners too.
class StampGuard {
 public:
  enum class Verdict {
    kNext,       ///< later than all before: use it
    kDrop,       ///< zero, repeated (or nearly), a little backward or alone far ahead: leave it out
    kJumpedBack  ///< the clock jumped back (a looped bag): start anew with it
  };

  /// clock_jump_s: a stamp that lies farther back than this [s] is a jump of the clock.
  explicit StampGuard(double clock_jump_s) : clock_jump_s_(clock_jump_s) {}

  /// Shortest step between two images [s]; over a shorter one no velocity has a meaning.
  static constexpr double kMinStep = 0.001;
  /// Longest step forward that is believed at once [s].
  static constexpr double kMaxAhead = 3600.0;

  Verdict check(const ros::Time& stamp);
  /// Why the last check() said kDrop; one sentence.
  const std::string& reason() const { return reason_; }

 private:
  const double clock_jump_s_;
  std::int64_t last_ns_ = 0;   ///< of the last image in use; 0: none
  std::int64_t ahead_ns_ = 0;  ///< far ahead, to be believed when the next one follows it; 0: none
  std::string reason_;
};

}  // namespace ground_scale_vo
