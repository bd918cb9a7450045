#include "vo/motion_model.hpp"

#include <algorithm>

#include "common/time.hpp"

namespace ground_scale_vo {
namespace {

/// Limits the prediction to this many times the interval over which the velocity was measured.
/// Two stamps that are closer together than their images give a wrong velocity; and after a long
/// interruption, objects that move along and the distant scene could fit a wrong predicted pose.
/// The value lies between an interruption after which tracking resumes in the tests (10 black
/// images) and one that needs a new map (41 black images behind a car).
constexpr double kMaxPredictedSteps = 12;

/// When the last two intervals differ by more than this factor, the velocity over both is
/// extrapolated: images in pairs have stamps with too short and too long intervals in turn.
constexpr double kMaxIntervalRatio = 2;

}  // namespace

Eigen::Isometry3d MotionModel::predict(std::int64_t stamp_ns) const {
  const double dt = secondsBetween(stamp_ns_, stamp_ns);
  return boxplus(T_w_c_, velocity_ * std::min(dt, kMaxPredictedSteps * velocity_dt_));
}

Eigen::Isometry3d MotionModel::extrapolate(std::int64_t stamp_ns) const {
  const double dt = secondsBetween(stamp_ns_, stamp_ns);
  return boxplus(T_w_c_, long_velocity_ * dt);
}

double MotionModel::stepsSince(std::int64_t stamp_ns) const {
  return long_dt_ > 0 ? secondsBetween(stamp_ns_, stamp_ns) / long_dt_ : 0;
}

Vector6d MotionModel::velocity() const {
  // velocity_ is the direction of the chord between two poses in the axes of the first. On an arc
  // the camera has turned by half of the rotation from the chord to the second.
  Vector6d velocity = velocity_;
  velocity.tail<3>() = motionFrom(-0.5 * velocity_dt_ * velocity_).linear() * velocity_.tail<3>();
  return velocity;
}

void MotionModel::update(const Eigen::Isometry3d& T_w_c, std::int64_t stamp_ns) {
  const double dt = secondsBetween(stamp_ns_, stamp_ns);
  if (dt > 0) {
    const Eigen::Isometry3d step = T_w_c_.inverse() * T_w_c;
    const Eigen::AngleAxisd rotation(step.linear());
    Vector6d velocity;
    velocity << rotation.angle() / dt * rotation.axis(), step.translation() / dt;
    const bool is_irregular =
        velocity_dt_ > 0 && std::max(dt / velocity_dt_, velocity_dt_ / dt) > kMaxIntervalRatio;
    long_dt_ = is_irregular ? velocity_dt_ + dt : dt;
    long_velocity_ = velocity;
    if (is_irregular) long_velocity_ = (velocity_dt_ * velocity_ + dt * velocity) / long_dt_;
    if (velocity_dt_ > 0) rotation_rate_change_ = (velocity - velocity_).head<3>().norm();
    velocity_ = velocity;
    velocity_dt_ = dt;
  }
  T_w_c_ = T_w_c;
  stamp_ns_ = stamp_ns;
}

}  // namespace ground_scale_vo
