#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {

/// The pose of the last tracked frame and the constant-velocity prediction of the next one.
class MotionModel {
 public:
  MotionModel() = default;
  /// Starts at a pose, without a velocity.
  MotionModel(const Eigen::Isometry3d& T_w_c, std::int64_t stamp_ns)
      : T_w_c_(T_w_c), stamp_ns_(stamp_ns) {}

  const Eigen::Isometry3d& T_w_c() const { return T_w_c_; }
  /// Twist (w, v) of the last motion, in the axes of the last pose [rad/s, VO units/s].
  Vector6d velocity() const;
  /// Between the last two intervals [rad/s].
  double rotationRateChange() const { return rotation_rate_change_; }

  /// Pose at constant velocity; after a long interruption the prediction stops.
  Eigen::Isometry3d predict(std::int64_t stamp_ns) const;

  /// Pose at constant velocity, however long ago it was measured; also for images in pairs.
  Eigen::Isometry3d extrapolate(std::int64_t stamp_ns) const;

  /// Time since the last pose over the interval in which the velocity was measured.
  double stepsSince(std::int64_t stamp_ns) const;

  /// Sets the pose of a newly tracked frame and measures the velocity since the last one.
  void update(const Eigen::Isometry3d& T_w_c, std::int64_t stamp_ns);

  /// Moves the last pose by a correction of the map in the axes of w (Mapping::applyAdjustment());
  /// the velocity is unchanged.
  void correct(const Eigen::Isometry3d& correction) { T_w_c_ = correction * T_w_c_; }

 private:
  Eigen::Isometry3d T_w_c_ = Eigen::Isometry3d::Identity();
  std::int64_t stamp_ns_ = 0;
  Vector6d velocity_ = Vector6d::Zero();  ///< (w, v) in the axes of c [rad/s, VO units/s]
  double rotation_rate_change_ = 0;
  double velocity_dt_ = 0;  ///< interval over which it was measured [s]
  /// The same over the last two intervals when these differ much in length.
  Vector6d long_velocity_ = Vector6d::Zero();
  double long_dt_ = 0;
};

}  // namespace ground_scale_vo
