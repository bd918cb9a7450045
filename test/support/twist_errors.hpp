#pragma once

#include <cstddef>

#include "common/time.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/metric_odometry.hpp"
#include "simulation/synthetic_drive.hpp"

namespace gsv {

/// Normalised errors of the twists of consecutive frames.
struct TwistErrors {
  Vector6d sum = Vector6d::Zero();  ///< of the squares
  int count = 0;

  /// frame: the one of the pose; not the first one.
  void add(const SyntheticDrive& drive, std::size_t frame, const MetricPose& pose) {
    const auto& then = drive.frame(frame - 1);
    const auto& now = drive.frame(frame);
    const Vector6d error = pose.twist_c - meanTwist(then.T_c0_c.inverse() * now.T_c0_c,
                                                    secondsBetween(then.stamp_ns, now.stamp_ns));
    sum += error.cwiseAbs2().cwiseQuotient(pose.twist_covariance.diagonal());
    ++count;
  }
  /// 1 for a consistent covariance.
  Vector6d rms() const { return (sum / count).cwiseSqrt(); }
};

}  // namespace gsv
