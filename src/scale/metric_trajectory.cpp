#include "ground_scale_vo/scale/metric_trajectory.hpp"

#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {
namespace {

double seconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-9; }

}  // namespace

void MetricTrajectory::Options::validate() const {
  visitParameters(*this, RangeCheck("trajectory/"));
}

MetricTrajectory::MetricTrajectory(const Options& options) : options_(options) {
  options_.validate();
}

void MetricTrajectory::reset() { *this = MetricTrajectory(options_); }

std::optional<MetricPose> MetricTrajectory::append(const VoFrame& frame,
                                                   const ScaleEstimate& scale) {
  if (frame.status != VoStatus::kTracking || scale.status == ScaleStatus::kUnknown ||
      !(scale.scale > 0)) {
    return std::nullopt;
  }
  const MetricTrajectory before = *this;
  const double dt = has_pose_ ? seconds(frame.stamp_ns - last_stamp_ns_) : 0;
  const bool new_map = has_pose_ && frame.map_id != last_map_id_;
  const double relative_sigma = scale.sigma / scale.scale;
  last_.twist_c.setZero();
  last_.twist_covariance.setZero();
  if (new_map) {
    // The pose stays; what the vehicle did meanwhile is not known.
    const double unseen_s = seconds(frame.stamp_ns - moving_stamp_ns_);
    Vector6d unseen;
    unseen << Eigen::Vector3d::Constant(unseen_s * options_.new_map_position_sigma_per_s),
        Eigen::Vector3d::Constant(unseen_s * options_.new_map_rotation_sigma_per_s);
    covariance_.topLeftCorner<6, 6>().diagonal() += unseen.cwiseAbs2();
    // The new map's scale has nothing to do with the old one's.
    covariance_.row(6).setZero();
    covariance_.col(6).setZero();
    covariance_(6, 6) = relative_sigma * relative_sigma;
  } else {
    if (!has_pose_) covariance_(6, 6) = relative_sigma * relative_sigma;
    move(last_T_w_c_.inverse() * frame.T_w_c, scale.scale, relative_sigma, has_pose_ ? dt : 0);
  }
  if (!has_pose_ || scale.reason != ScaleReason::kStandstill) moving_stamp_ns_ = frame.stamp_ns;
  has_pose_ = true;
  last_map_id_ = frame.map_id;
  last_stamp_ns_ = frame.stamp_ns;
  last_T_w_c_ = frame.T_w_c;
  last_.covariance = covariance_.topLeftCorner<6, 6>();
  if (areFinite(last_.T_o_c, last_.distance, covariance_, last_.twist_c, last_.twist_covariance)) {
    return last_;
  }
  *this = before;
  return std::nullopt;
}

/// Appends one increment. dt: [s], 0 when the increment is not one frame's and has no twist.
void MetricTrajectory::move(const Eigen::Isometry3d& T_last_now, double scale,
                            double relative_sigma, double dt) {
  const Eigen::Vector3d step_last = scale * T_last_now.translation();  // Eq. 10 [m]
  const Eigen::Vector3d step_o = last_.T_o_c.linear() * step_last;
  const double length = step_last.norm();

  // Covariance of (position, rotation, relative scale error). The scale error is one random number
  // that changes slowly along the way, so the position error grows with the distance itself over
  // scale_correlation_m and only then with its root.
  const double kept = std::exp(-length / options_.scale_correlation_m);
  Matrix7d F = Matrix7d::Identity();
  F.block<3, 3>(0, 3) = -skew(step_o);
  F.block<3, 1>(0, 6) = step_o;
  F(6, 6) = kept;
  const double rotation_variance = std::pow(options_.rotation_sigma_per_sqrt_m, 2) * length;
  // Noise of the direction: across the step alone.
  const Eigen::Matrix3d across =
      std::pow(options_.direction_sigma, 2) *
      (length * length * Eigen::Matrix3d::Identity() - step_o * step_o.transpose());
  const double scale_variance = relative_sigma * relative_sigma;
  covariance_ = F * covariance_ * F.transpose();
  covariance_.block<3, 3>(0, 0) += across;
  covariance_.block<3, 3>(3, 3) += rotation_variance * Eigen::Matrix3d::Identity();
  covariance_(6, 6) += (1 - kept * kept) * scale_variance;
  // The estimate says how uncertain its scale is now; correlations shrink or grow with it.
  if (covariance_(6, 6) > 0) {
    const double ratio = relative_sigma / std::sqrt(covariance_(6, 6));
    covariance_.row(6) *= ratio;
    covariance_.col(6) *= ratio;
  } else {
    covariance_(6, 6) = scale_variance;
  }

  last_.T_o_c.translation() += step_o;
  last_.T_o_c.linear() = Eigen::Quaterniond(last_.T_o_c.linear() * T_last_now.linear())
                             .normalized()
                             .toRotationMatrix();
  last_.distance += length;
  if (!(dt > 0)) return;

  // Mean velocity over the step, in the axes of the camera now.
  const Eigen::AngleAxisd turn(T_last_now.linear());
  const Eigen::Vector3d step_c = T_last_now.linear().transpose() * step_last;
  last_.twist_c << step_c / dt, turn.angle() * turn.axis() / dt;
  last_.twist_covariance.topLeftCorner<3, 3>() =
      (std::pow(options_.direction_sigma, 2) *
           (length * length * Eigen::Matrix3d::Identity() - step_c * step_c.transpose()) +
       scale_variance * step_c * step_c.transpose()) /
      (dt * dt);
  last_.twist_covariance.bottomRightCorner<3, 3>() =
      rotation_variance / (dt * dt) * Eigen::Matrix3d::Identity();
}

}  // namespace ground_scale_vo
