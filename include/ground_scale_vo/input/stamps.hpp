#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>

namespace gsv {

/// Passes on the messages of a stream whose stamps [ns] can be used, in the order of arrival: the
/// images of every door, vo/frame in ScaleRecovery.
///
/// A stamp far from the last one, in either direction, is accepted only when the next stamp
/// continues from it: then the clock has jumped, or the camera has paused. Until then its message
/// is held. A single one is a fault: accepting it would reset the nodelet or put all later images
/// in the past, for tf listeners too.
class StampFilter {
 public:
  /// clock_jumped_back: between the previous message and this one, as in a looped bag.
  using Process = std::function<void(bool clock_jumped_back)>;
  using OnDrop = std::function<void(const std::string& reason)>;  ///< reason: one sentence

  static constexpr double kDefaultClockJump = 1.0;  // [s]
  static constexpr double kHoldIntervalsOfFiles = 3;

  /// clock_jump_s: a stamp that is earlier by more than this [s], or later by more than this and
  /// 1.5 times the last interval, is held. on_drop: is called for each message that is not passed
  /// on. zero_is_unset: a stamp of zero is that of a message without a stamp, not the first one of
  /// a file. hold_intervals: a stamp that is later by more than so many intervals is held too. A
  /// wrong one then costs one image instead of those that it puts in the past; a file waits for the
  /// next image at no cost, a live camera with dropped images would not.
  StampFilter(double clock_jump_s, OnDrop on_drop, bool zero_is_unset = true,
              double hold_intervals = std::numeric_limits<double>::infinity());

  /// Calls `process` of the messages to process now: none, this one, or the held one and this one.
  void add(std::int64_t stamp_ns, Process process);

 private:
  const double clock_jump_s_;
  const OnDrop on_drop_;
  const bool zero_is_unset_;
  const double hold_intervals_;
  std::optional<std::int64_t> last_ns_;  ///< last accepted stamp
  double interval_s_ = 0;                ///< between the last two accepted stamps
  std::optional<std::int64_t> held_ns_;  ///< of the held message
  Process held_;
  std::string held_reason_;  ///< why it is dropped unless the next stamp confirms it
};

}  // namespace gsv
