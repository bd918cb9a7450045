#include "ground_scale_vo/input/stamps.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "common/time.hpp"

namespace gsv {
namespace {

/// Shortest interval between two stamps [s]; a shorter one gives no meaningful velocity.
constexpr double kMinStep = 0.001;
/// Longest interval over the previous one, for cameras slower than clock_jump_s.
constexpr double kMaxIntervalRatio = 1.5;

bool follows(std::int64_t from_ns, std::int64_t stamp_ns, double max_s) {
  const double step_s = secondsBetween(from_ns, stamp_ns);
  return step_s >= kMinStep && step_s <= max_s;
}

}  // namespace

StampFilter::StampFilter(double clock_jump_s, OnDrop on_drop, bool zero_is_unset,
                         double hold_intervals)
    : clock_jump_s_(clock_jump_s),
      on_drop_(std::move(on_drop)),
      zero_is_unset_(zero_is_unset),
      hold_intervals_(hold_intervals) {}

void StampFilter::add(std::int64_t stamp_ns, Process process) {
  const std::optional<std::int64_t> held_ns = std::exchange(held_ns_, std::nullopt);
  const Process held = std::exchange(held_, nullptr);
  const double hold_s =
      interval_s_ > 0 ? std::min(clock_jump_s_, hold_intervals_ * interval_s_) : clock_jump_s_;
  const double max_step_s = std::max(hold_s, kMaxIntervalRatio * interval_s_);
  const bool is_unset = stamp_ns == 0 && zero_is_unset_;
  const bool continues = !is_unset && (!last_ns_ || follows(*last_ns_, stamp_ns, max_step_s));
  const std::int64_t last_ns = last_ns_.value_or(stamp_ns);
  if (held_ns && !continues && !is_unset) {
    // An interval as long as the jump confirms it too: the camera may have become slower.
    const double jump_s = secondsBetween(last_ns, *held_ns);
    if (follows(*held_ns, stamp_ns, std::max(max_step_s, std::abs(jump_s)))) {
      last_ns_ = stamp_ns;
      interval_s_ = secondsBetween(*held_ns, stamp_ns);
      held(jump_s < 0);
      return process(false);
    }
  }
  if (held_ns) on_drop_(held_reason_);
  if (is_unset) return on_drop_("the stamp is zero");
  const double step_s = secondsBetween(last_ns, stamp_ns);
  if (continues) {
    last_ns_ = stamp_ns;
    if (step_s > 0) interval_s_ = step_s;
    return process(false);
  }
  std::ostringstream sentence;
  sentence << "the stamp " << formatSeconds(stamp_ns);
  if (step_s > max_step_s || step_s < -clock_jump_s_) {
    sentence << " is " << std::abs(step_s) << " s " << (step_s > 0 ? "after" : "before")
             << " the last one and not confirmed by the next one";
    held_ns_ = stamp_ns;
    held_ = std::move(process);
    held_reason_ = sentence.str();
    return;
  }
  sentence << " is not at least " << kMinStep << " s later than the last one, "
           << formatSeconds(last_ns);
  on_drop_(sentence.str());
}

}  // namespace gsv
