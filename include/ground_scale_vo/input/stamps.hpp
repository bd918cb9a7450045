#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace ground_scale_vo {

/// Checks the stamps [ns] of a stream: of the images of every door, of vo/frame in ScaleRecovery.
///
/// A stamp far from the last one, in either direction, is accepted only when the next stamp
/// continues from it: then the clock has jumped, or the camera has paused. A single one is a fault:
/// accepting it would reset the nodelet or put all later images in the past, for tf listeners too.
class StampGuard {
 public:
  enum class Verdict {
    kAccept,       ///< continues from the last accepted stamp
    kDrop,         ///< zero, (nearly) repeated, or slightly backward
    kHold,         ///< far from the last accepted stamp: hold the message until the next one
    kJumpedAhead,  ///< the held message is valid, this one continues from it: a pause, a clock jump
    kJumpedBack    ///< the same after a jump back, as in a looped bag: reset, then process both
  };

  /// clock_jump_s: a stamp that is earlier by more than this [s], or later by more than this and
  /// kMaxIntervalRatio times the last interval, is held. zero_is_unset: a stamp of zero is that of
  /// a message without a stamp, not the first one of a file. hold_intervals: a stamp that is later
  /// by more than so many intervals is held too. A wrong one then costs one image instead of those
  /// that it puts in the past; a file waits for the next image at no cost, a live camera with
  /// dropped images would not.
  explicit StampGuard(double clock_jump_s, bool zero_is_unset = true,
                      double hold_intervals = std::numeric_limits<double>::infinity())
      : clock_jump_s_(clock_jump_s),
        zero_is_unset_(zero_is_unset),
        hold_intervals_(hold_intervals) {}

  static constexpr double kDefaultClockJump = 1.0;  // [s]

  /// Shortest interval between two stamps [s]; a shorter one gives no meaningful velocity.
  static constexpr double kMinStep = 0.001;
  static constexpr double kHoldIntervalsOfFiles = 3;
  /// Longest interval over the previous one, for cameras slower than clock_jump_s.
  static constexpr double kMaxIntervalRatio = 1.5;

  /// After kHold, any verdict but kJumpedAhead and kJumpedBack means that the held message is to be
  /// dropped.
  Verdict check(std::int64_t stamp_ns);
  /// One sentence: why the last check() returned kDrop or kHold.
  const std::string& reason() const { return reason_; }

 private:
  Verdict accept(std::int64_t stamp_ns, std::optional<std::int64_t> previous_ns, Verdict verdict);

  const double clock_jump_s_;
  const bool zero_is_unset_;
  const double hold_intervals_;
  std::optional<std::int64_t> last_ns_;  ///< last accepted stamp
  std::optional<std::int64_t> held_ns_;  ///< stamp of the held message
  double interval_s_ = 0;                ///< between the last two accepted stamps
  std::string reason_;
};

/// Passes on the messages whose stamps StampGuard accepts, in the order of arrival.
template <typename Message>
class StampFilter {
 public:
  struct Accepted {
    Message message;
    bool clock_jumped_back;  ///< between the previous message and this one
  };
  using OnDrop = std::function<void(const std::string& reason)>;

  StampFilter(double clock_jump_s, OnDrop on_drop)
      : StampFilter(StampGuard(clock_jump_s), std::move(on_drop)) {}
  StampFilter(const StampGuard& guard, OnDrop on_drop)
      : guard_(guard), on_drop_(std::move(on_drop)) {}

  /// The messages to process now: none, this one, or the one that was held and this one.
  std::vector<Accepted> filter(std::int64_t stamp_ns, Message message) {
    using Verdict = StampGuard::Verdict;
    std::optional<Message> held = std::exchange(held_, std::nullopt);
    const std::string held_reason = guard_.reason();
    std::vector<Accepted> accepted;
    const Verdict verdict = guard_.check(stamp_ns);
    if (verdict == Verdict::kJumpedAhead || verdict == Verdict::kJumpedBack) {
      accepted.push_back({std::move(*held), verdict == Verdict::kJumpedBack});
    } else if (held) {
      on_drop_(held_reason);
    }
    if (verdict == Verdict::kHold) {
      held_ = std::move(message);
    } else if (verdict == Verdict::kDrop) {
      on_drop_(guard_.reason());
    } else {
      accepted.push_back({std::move(message), false});
    }
    return accepted;
  }

 private:
  StampGuard guard_;
  const OnDrop on_drop_;
  std::optional<Message> held_;
};

}  // namespace ground_scale_vo
