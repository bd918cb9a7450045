#include "ground_scale_vo/scale/metric_trajectory.hpp"

#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"

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
  const double relative_sigma = scale.sigma / scale.scale;
  last_.twist_c.setZero();
  last_.twist_covariance.setZero();
  if (has_pose_ && frame.map_id != last_map_id_) {
    bridgeMaps(frame.stamp_ns, relative_sigma);
  } else {
    if (!has_pose_) covariance_(6, 6) = relative_sigma * relative_sigma;
    const double dt = has_pose_ ? seconds(frame.stamp_ns - last_stamp_ns_) : 0;
    integrate(last_T_w_c_.inverse() * frame.T_w_c, scale.scale, relative_sigma, dt);
  }
  if (!has_pose_ || scale.reason != ScaleReason::kStandstill) {
    last_motion_stamp_ns_ = frame.stamp_ns;
  }
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

/// First frame of a later map: keeps the pose, adds the uncertainty of the unobserved motion. The
/// scale error of the new map is independent of that of the old one.
void MetricTrajectory::bridgeMaps(std::int64_t stamp_ns, double relative_sigma) {
  const double unobserved_s = seconds(stamp_ns - last_motion_stamp_ns_);
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(unobserved_s * options_.new_map_position_sigma_per_s),
      Eigen::Vector3d::Constant(unobserved_s * options_.new_map_rotation_sigma_per_s);
  covariance_.topLeftCorner<6, 6>().diagonal() += sigma.cwiseAbs2();
  covariance_.row(6).setZero();
  covariance_.col(6).setZero();
  covariance_(6, 6) = relative_sigma * relative_sigma;
}

/// Appends one increment. dt: [s]; 0: no twist, because the increment spans more than one frame.
void MetricTrajectory::integrate(const Eigen::Isometry3d& T_last_now, double scale,
                                 double relative_sigma, double dt) {
  const Eigen::Vector3d step_last = scale * T_last_now.translation();  // Eq. 10 [m]
  const Eigen::Vector3d step_o = last_.T_o_c.linear() * step_last;
  const double length = step_last.norm();
  propagateCovariance(step_o, length, relative_sigma);
  last_.T_o_c.translation() += step_o;
  last_.T_o_c.linear() = Eigen::Quaterniond(last_.T_o_c.linear() * T_last_now.linear())
                             .normalized()
                             .toRotationMatrix();
  last_.distance += length;
  if (dt > 0) setTwist(T_last_now, step_last, relative_sigma, dt);
}

/// P <- F P F^T + Q for the state (position, rotation, relative scale error). step_o: metric
/// increment in o axes, of the given length.
void MetricTrajectory::propagateCovariance(const Eigen::Vector3d& step_o, double length,
                                           double relative_sigma) {
  const double scale_variance = relative_sigma * relative_sigma;
  // Gauss-Markov process of the scale error: this share of it remains after the increment.
  const double correlation = std::exp(-length / options_.scale_correlation_m);
  Matrix7d F = Matrix7d::Identity();
  F.block<3, 3>(0, 3) = -skew(step_o);
  F.block<3, 1>(0, 6) = step_o;
  F(6, 6) = correlation;
  covariance_ = F * covariance_ * F.transpose();
  covariance_.block<3, 3>(0, 0) += directionCovariance(step_o, length);
  covariance_.block<3, 3>(3, 3) += rotationVariance(length) * Eigen::Matrix3d::Identity();
  covariance_(6, 6) += (1 - correlation * correlation) * scale_variance;
  // The scale filter provides the variance of the scale error; only the correlations are propagated
  // here, so the row and column are rescaled to it.
  if (covariance_(6, 6) > 0) {
    const double ratio = relative_sigma / std::sqrt(covariance_(6, 6));
    covariance_.row(6) *= ratio;
    covariance_.col(6) *= ratio;
  } else {
    covariance_(6, 6) = scale_variance;
  }
}

/// Mean velocity over the increment, in the axes of the camera now.
void MetricTrajectory::setTwist(const Eigen::Isometry3d& T_last_now,
                                const Eigen::Vector3d& step_last, double relative_sigma,
                                double dt) {
  const double length = step_last.norm();
  const Eigen::AngleAxisd rotation(T_last_now.linear());
  const Eigen::Vector3d step_c = T_last_now.linear().transpose() * step_last;
  last_.twist_c << step_c / dt, rotation.angle() * rotation.axis() / dt;
  last_.twist_covariance.topLeftCorner<3, 3>() =
      (directionCovariance(step_c, length) +
       relative_sigma * relative_sigma * step_c * step_c.transpose()) /
      (dt * dt);
  last_.twist_covariance.bottomRightCorner<3, 3>() =
      rotationVariance(length) / (dt * dt) * Eigen::Matrix3d::Identity();
}

/// Of a step whose direction has an error: variance only orthogonal to the step [m^2].
Eigen::Matrix3d MetricTrajectory::directionCovariance(const Eigen::Vector3d& step,
                                                      double length) const {
  return std::pow(options_.direction_sigma, 2) *
         (length * length * Eigen::Matrix3d::Identity() - step * step.transpose());
}

/// Of the rotation's random walk over a distance [rad^2].
double MetricTrajectory::rotationVariance(double length) const {
  return std::pow(options_.rotation_sigma_per_sqrt_m, 2) * length;
}

}  // namespace ground_scale_vo
