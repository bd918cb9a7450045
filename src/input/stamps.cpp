#include "ground_scale_vo/input/stamps.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "common/time.hpp"

namespace ground_scale_vo {
namespace {

bool follows(std::int64_t from_ns, std::int64_t stamp_ns, double max_s) {
  const double step_s = secondsBetween(from_ns, stamp_ns);
  return step_s >= StampGuard::kMinStep && step_s <= max_s;
}

}  // namespace

StampGuard::Verdict StampGuard::check(std::int64_t stamp_ns) {
  const std::optional<std::int64_t> held_ns = std::exchange(held_ns_, std::nullopt);
  if (stamp_ns == 0 && zero_is_unset_) {
    reason_ = "the stamp is zero";
    return Verdict::kDrop;
  }
  const double hold_s =
      interval_s_ > 0 ? std::min(clock_jump_s_, hold_intervals_ * interval_s_) : clock_jump_s_;
  const double max_step_s = std::max(hold_s, kMaxIntervalRatio * interval_s_);
  if (!last_ns_ || follows(*last_ns_, stamp_ns, max_step_s)) {
    return accept(stamp_ns, last_ns_, Verdict::kAccept);
  }
  if (held_ns) {
    // An interval as long as the jump confirms it too: the camera may have become slower.
    const double jump_s = secondsBetween(*last_ns_, *held_ns);
    if (follows(*held_ns, stamp_ns, std::max(max_step_s, std::abs(jump_s)))) {
      return accept(stamp_ns, held_ns, jump_s > 0 ? Verdict::kJumpedAhead : Verdict::kJumpedBack);
    }
  }
  const double step_s = secondsBetween(*last_ns_, stamp_ns);
  std::ostringstream sentence;
  sentence << "the stamp " << formatSeconds(stamp_ns);
  if (step_s > max_step_s || step_s < -clock_jump_s_) {
    held_ns_ = stamp_ns;
    sentence << " is " << std::abs(step_s) << " s " << (step_s > 0 ? "after" : "before")
             << " the last one and not confirmed by the next one";
    reason_ = sentence.str();
    return Verdict::kHold;
  }
  sentence << " is not at least " << kMinStep << " s later than the last one, "
           << formatSeconds(*last_ns_);
  reason_ = sentence.str();
  return Verdict::kDrop;
}

StampGuard::Verdict StampGuard::accept(std::int64_t stamp_ns,
                                       std::optional<std::int64_t> previous_ns, Verdict verdict) {
  if (previous_ns) interval_s_ = secondsBetween(*previous_ns, stamp_ns);
  last_ns_ = stamp_ns;
  return verdict;
}

}  // namespace ground_scale_vo
