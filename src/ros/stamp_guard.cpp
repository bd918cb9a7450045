#include "ground_scale_vo/ros/stamp_guard.hpp"

#include <sstream>

#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {
namespace {

// Not with ros::Duration, which throws beyond 2^31 s.
bool follows(std::int64_t last_ns, std::int64_t stamp_ns) {
  return secondsBetween(last_ns, stamp_ns) >= StampGuard::kMinStep &&
         secondsBetween(last_ns, stamp_ns) <= StampGuard::kMaxAhead;
}

}  // namespace

StampGuard::Verdict StampGuard::check(const ros::Time& stamp) {
  const std::int64_t stamp_ns = toNanoseconds(stamp);
  const std::int64_t ahead_ns = ahead_ns_;
  ahead_ns_ = 0;
  if (stamp_ns == 0) {
    reason_ = "the stamp is zero";
    return Verdict::kDrop;
  }
  if (last_ns_ == 0 || follows(last_ns_, stamp_ns) ||
      (ahead_ns != 0 && follows(ahead_ns, stamp_ns))) {
    last_ns_ = stamp_ns;
    return Verdict::kAccept;
  }
  std::ostringstream sentence;
  sentence << "the stamp " << stamp;
  if (secondsBetween(last_ns_, stamp_ns) > kMaxAhead) {
    ahead_ns_ = stamp_ns;
    sentence << " is " << secondsBetween(last_ns_, stamp_ns)
             << " s after the last one and not confirmed by a second one";
  } else if (secondsBetween(stamp_ns, last_ns_) > clock_jump_s_) {
    last_ns_ = stamp_ns;
    return Verdict::kJumpedBack;
  } else {
    sentence << " is not at least " << kMinStep << " s later than the last one, "
             << fromNanoseconds(last_ns_);
  }
  reason_ = sentence.str();
  return Verdict::kDrop;
}

}  // namespace ground_scale_vo
