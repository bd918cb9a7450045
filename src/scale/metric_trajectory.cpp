#include "scale/metric_trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// Steps of the numerical integration over a gap between two maps.
constexpr int kBridgeSteps = 16;

/// White noise of a position [camera heights] and of a rotation [rad], for the covariance of the
/// twist: it never vanishes. That of the rotation is measured on KITTI, without the noise of its
/// ground truth.
constexpr double kPositionNoise = 0.002, kRotationNoise = 0.00015;
/// Relative standard deviation of the length of a gap by the speeds.
constexpr double kGapLengthSigma = 0.02;
/// [m] Over which the errors of two poses, which share map points, come to differ by the covariance
/// of one pose; after twice this they count as independent.
constexpr double kPoseCorrelation = 2;
/// [m/s] Standard deviation of the velocity when a standstill ends in a new map.
constexpr double kUnobservedSpeedSigma = 5;
/// [rad/s] Of the rotation rate between two maps, where the odometry does not know the rotation.
constexpr double kUnknownRotationSigma = 0.1;
/// [m/s, rad/s] Standard deviation of a twist that is not known.
constexpr double kUnknownSpeedSigma = 50;

/// Displacement in start axes over dt, at a constant rotation rate from the start to the end, with
/// a velocity in body axes that changes linearly.
Eigen::Vector3d arc(const Eigen::Matrix3d& R_start_end, const Eigen::Vector3d& velocity_start,
                    const Eigen::Vector3d& velocity_end, double dt) {
  const Eigen::AngleAxisd rotation(R_start_end);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int i = 0; i < kBridgeSteps; ++i) {
    const double share = (i + 0.5) / kBridgeSteps;
    sum += Eigen::AngleAxisd(share * rotation.angle(), rotation.axis()) *
           ((1 - share) * velocity_start + share * velocity_end);
  }
  return sum * dt / kBridgeSteps;
}

/// P in axes a for P in axes b.
Matrix6d rotated(const Eigen::Matrix3d& R_a_b, const Matrix6d& P) {
  Matrix6d R = Matrix6d::Zero();
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = R_a_b;
  return R * P * R.transpose();
}

/// Relative variance of the scale by the camera height, which is the same along the drive ...
double heightVariance(const ScaleEstimate& scale) {
  if (!(scale.camera_height > 0)) return 0;
  return std::min(std::pow(scale.camera_height_sigma / scale.camera_height, 2),
                  std::pow(scale.sigma / scale.scale, 2));
}

/// ... and by everything else.
double ownVariance(const ScaleEstimate& scale) {
  return std::pow(scale.sigma / scale.scale, 2) - heightVariance(scale);
}

}  // namespace

std::optional<MetricPose> MetricTrajectory::append(const VoFrame& frame, Continuity continuity,
                                                   const ScaleEstimate& scale,
                                                   const SpeedTrack& speeds) {
  if (!first_seen_ns_) first_seen_ns_ = frame.stamp_ns;
  if (continuity >= Continuity::kNewMapSameUnit) {
    start_ = continuity > frame.continuity ? Start::kInItsMiddle : Start::kUnseen;
  }
  if (frame.status == VoStatus::kInitialising && start_ == Start::kUnseen) start_ = Start::kSeen;
  if (frame.status != VoStatus::kTracking || !isFinite(frame.T_w_c) ||
      scale.measurement == MeasurementStatus::kVoNotTracking ||
      scale.measurement == MeasurementStatus::kImplausibleMotion) {
    if (frame.status == VoStatus::kTracking) last_refused_stamp_ns_ = frame.stamp_ns;
    return std::nullopt;
  }
  const MetricTrajectory before = *this;
  std::optional<MetricPose> pose = appendTracked(frame, scale, speeds);
  if (areFinite(last_.T_o_c, last_.distance, last_.covariance, covariance_, last_.twist_c,
                last_.twist_covariance)) {
    return pose;
  }
  *this = before;
  return std::nullopt;
}

std::optional<MetricPose> MetricTrajectory::appendTracked(const VoFrame& frame,
                                                          const ScaleEstimate& scale,
                                                          const SpeedTrack& speeds) {
  StampedPose previous = last_tracked_;
  if (start_ != Start::kBefore) {
    map_ = newMap(frame);
    start_ = Start::kBefore;
    last_step_s_ = 0;
    previous = {map_->ref_stamp_ns, map_->T_w_ref};
  }
  if (scale.measurement == MeasurementStatus::kStandstill &&
      speeds.standsStill(previous.stamp_ns, frame.stamp_ns)) {
    // What moves in the images is not the vehicle: the map's reference moves with the camera.
    if (!map_->before_stop) map_->before_stop = {map_->T_w_ref, previous.T_w_c};
    map_->T_w_ref = frame.T_w_c * previous.T_w_c.inverse() * map_->T_w_ref;
    previous.T_w_c = frame.T_w_c;
  } else if (map_->before_stop) {
    if (speeds.isZero()) std::tie(map_->T_w_ref, previous.T_w_c) = *map_->before_stop;
    map_->before_stop.reset();
  }
  map_->travelled += (frame.T_w_c.translation() - previous.T_w_c.translation()).norm();
  last_tracked_ = {frame.stamp_ns, frame.T_w_c};
  if (scale.status == ScaleStatus::kUnknown || !(scale.scale > 0)) return std::nullopt;

  pose_covariance_c_ = withScaledPosition(frame.pose_covariance, scale.scale);
  const Eigen::Isometry3d T_ref_c = map_->T_w_ref.inverse() * frame.T_w_c;
  const Eigen::Isometry3d T_previous_c = previous.T_w_c.inverse() * frame.T_w_c;
  if (!map_->metric) {
    anchorMap(T_ref_c, scale, secondsBetween(map_->ref_stamp_ns, frame.stamp_ns), speeds);
    rescaleYoungMap(T_ref_c, T_ref_c, scale);
  } else if (map_->young) {
    rescaleYoungMap(T_previous_c, T_ref_c, scale);
  } else {
    integrate(T_previous_c, scale);
  }
  if (!has_pose_ || scale.measurement != MeasurementStatus::kStandstill) {
    last_motion_stamp_ns_ = frame.stamp_ns;
  }
  has_pose_ = true;
  last_stamp_ns_ = frame.stamp_ns;
  setTwist(T_previous_c, scale, secondsBetween(previous.stamp_ns, frame.stamp_ns));
  return last_;
}

bool MetricTrajectory::countsFromStart(const VoFrame& frame) const {
  const bool starts = frame.continuity >= Continuity::kNewMapSameUnit || start_ != Start::kBefore;
  if (!starts || start_ == Start::kInItsMiddle) return false;
  const std::int64_t start_ns = frame.map_start.stamp_ns;
  if (start_ns != 0) {
    return start_ns <= frame.stamp_ns && first_seen_ns_.value_or(frame.stamp_ns) <= start_ns;
  }
  return !map_ && start_ == Start::kSeen && frame.continuity < Continuity::kNewMapSameUnit;
}

/// The map that starts with this frame. The rotation since the last metric pose is the product over
/// all maps in between, which had no scale.
MetricTrajectory::Map MetricTrajectory::newMap(const VoFrame& frame) const {
  const MapStart& start = frame.map_start;
  const bool is_first = !map_.has_value();
  const bool from_start = countsFromStart(frame);
  const bool has_start = from_start && start.stamp_ns != 0;
  Map map;
  if (!from_start) map.T_w_ref = frame.T_w_c;
  map.ref_stamp_ns = has_start ? start.stamp_ns : frame.stamp_ns;
  if (!is_first && !map_->metric) {
    map.R_last_ref =
        map_->R_last_ref * map_->T_w_ref.linear().transpose() * last_tracked_.T_w_c.linear();
    map.rotation_variance = map_->rotation_variance;
  }
  if (has_start && std::isfinite(start.rotation_sigma)) {
    map.R_last_ref = renormalised(map.R_last_ref * start.R_previous_w);
    map.rotation_variance += start.rotation_sigma * start.rotation_sigma;
    // It counts from the last pose of the odometry, which was refused.
    const double unknown_s = secondsBetween(last_tracked_.stamp_ns, last_refused_stamp_ns_);
    if (!is_first && unknown_s > 0) {
      map.rotation_variance += std::pow(unknown_s * kUnknownRotationSigma, 2);
    }
  } else if (!is_first) {
    const std::int64_t since_ns = map_->metric ? last_motion_stamp_ns_ : last_tracked_.stamp_ns;
    const double dt = std::max(0.0, secondsBetween(since_ns, map.ref_stamp_ns));
    map.rotation_variance += std::pow(dt * kUnknownRotationSigma, 2);
  }
  return map;
}

/// First metric frame of a map: determines the pose of its reference frame, from which it has moved
/// by T_ref_c in dt [s].
void MetricTrajectory::anchorMap(const Eigen::Isometry3d& T_ref_c, const ScaleEstimate& scale,
                                 double dt, const SpeedTrack& speeds) {
  map_->metric = true;
  if (has_pose_) {
    const Eigen::Vector3d motion = scale.scale * T_ref_c.translation();
    if (dt > 0) {
      bridgeGap(motion / dt, motion.norm() / dt * scale.sigma / scale.scale, speeds);
    } else {
      bridgeGap(std::nullopt, 0, speeds);
    }
  } else {
    last_.T_o_c.linear() = map_->R_last_ref;
    covariance_.block<3, 3>(3, 3).diagonal().setConstant(map_->rotation_variance);
  }
  map_->T_o_ref = last_.T_o_c;
  map_->distance_at_ref = last_.distance;
}

/// Moves last_ and covariance_ to the reference frame of a later map. velocity_ref: mean velocity
/// after it [m/s], reference axes, if known. velocity_sigma: standard deviation of its length.
void MetricTrajectory::bridgeGap(const std::optional<Eigen::Vector3d>& velocity_ref,
                                 double velocity_sigma, const SpeedTrack& speeds) {
  double length_sigma = 0;
  const std::optional<double> length =  // of the gap
      speeds.agrees() ? speeds.distance(last_stamp_ns_, map_->ref_stamp_ns, &length_sigma)
                      : std::nullopt;
  const double metres = length.value_or(0);
  const bool stood_still = !length && last_motion_stamp_ns_ < last_stamp_ns_;
  const double dt = std::max(0.0, secondsBetween(last_stamp_ns_, map_->ref_stamp_ns));
  const bool two_ended = velocity_ref.has_value();
  Eigen::Vector3d gap = Eigen::Vector3d::Zero();
  Matrix6d P = last_.covariance;
  double gap_variance = 0;  // of each axis
  if (stood_still) {
    const double unobserved_s = secondsBetween(last_motion_stamp_ns_, map_->ref_stamp_ns);
    gap_variance = std::pow(unobserved_s * kUnobservedSpeedSigma, 2);
  } else {
    gap = arc(map_->R_last_ref, velocity_c_, velocity_ref.value_or(velocity_c_), dt);
    // Displacement error of an unknown acceleration; half of it if both ends are known.
    const double acceleration_sigma =
        options_.bridge_acceleration_sigma * dt * dt / (two_ended ? 4 : 2);
    const double speed_variance =
        two_ended ? 0.25 * (velocity_variance_ + velocity_sigma * velocity_sigma)
                  : velocity_variance_;
    gap_variance = acceleration_sigma * acceleration_sigma + speed_variance * dt * dt;
    if (length && gap.norm() > 0) {
      gap *= std::abs(metres) / gap.norm();
      gap_variance = std::pow(length_sigma, 2) + std::pow(kGapLengthSigma * metres, 2);
    }
  }
  P.diagonal().head<3>().array() += gap_variance;
  const Eigen::Vector3d gap_o = last_.T_o_c.linear() * gap;
  Matrix6d F = Matrix6d::Identity();
  F.topRightCorner<3, 3>() = -skew(gap_o);
  P = F * P * F.transpose();
  // A rotation error that grows linearly over the gap turns the gap by half of it.
  Eigen::Matrix<double, 6, 3> G;
  G << -0.5 * skew(gap_o), Eigen::Matrix3d::Identity();
  P += map_->rotation_variance * G * G.transpose();
  // The errors of scale and angle belong to the map before.
  covariance_.middleRows<2>(6).setZero();
  covariance_.middleCols<2>(6).setZero();
  covariance_.topLeftCorner<6, 6>() = P;
  covariance_(9, 9) = std::pow(last_.distance_sigma, 2) + gap_variance;
  last_.T_o_c.translation() += gap_o;
  last_.T_o_c.linear() = renormalised(last_.T_o_c.linear() * map_->R_last_ref);
  last_.distance += gap.norm();
}

/// Pose of a young map's frame: the whole motion T_ref_c since the reference frame times the newest
/// scale. T_last_c: motion since the last pose. covariance_ does not contain the scale error yet,
/// which is proportional to the motion since the reference frame.
void MetricTrajectory::rescaleYoungMap(const Eigen::Isometry3d& T_last_c,
                                       const Eigen::Isometry3d& T_ref_c,
                                       const ScaleEstimate& scale) {
  propagateMotion(T_last_c, scale, 1);
  const Eigen::Vector3d motion_o = map_->T_o_ref.linear() * T_ref_c.translation() * scale.scale;
  last_.T_o_c.translation() = map_->T_o_ref.translation() + motion_o;
  last_.T_o_c.linear() = renormalised(map_->T_o_ref.linear() * T_ref_c.linear());
  last_.distance = map_->distance_at_ref + scale.scale * map_->travelled;
  const double variance = ownVariance(scale);
  StateCovariance with_scale = covariance_;
  with_scale.topLeftCorner<3, 3>() += variance * motion_o * motion_o.transpose();
  with_scale.block<3, 1>(0, 6) = variance * motion_o;
  with_scale.block<1, 3>(6, 0) = variance * motion_o.transpose();
  with_scale(6, 6) = variance;
  const double metres = scale.scale * map_->travelled;
  with_scale(9, 9) += variance * metres * metres;
  with_scale(9, 6) = with_scale(6, 9) = variance * metres;
  setLast(with_scale);
  if (map_->travelled < options_.young_map_heights * scale.height) return;
  map_->young = false;
  covariance_ = with_scale;
}

/// Appends the motion T_last_c since the last pose.
void MetricTrajectory::integrate(const Eigen::Isometry3d& T_last_c, const ScaleEstimate& scale) {
  const Eigen::Vector3d step_o =
      last_.T_o_c.linear() * T_last_c.translation() * scale.scale;  // Eq. 10 [m]
  const double length = step_o.norm();
  // Gauss-Markov process of the scale error: this share of it remains after the increment.
  const double correlation = std::exp(-length / options_.scale_correlation_m);
  const double variance = ownVariance(scale);
  propagateMotion(T_last_c, scale, correlation);
  covariance_(6, 6) += (1 - correlation * correlation) * variance;
  setVariance(6, variance);
  last_.T_o_c.translation() += step_o;
  last_.T_o_c.linear() = renormalised(last_.T_o_c.linear() * T_last_c.linear());
  last_.distance += length;
  setLast(covariance_);
}

void MetricTrajectory::setLast(const StateCovariance& covariance) {
  last_.covariance = covariance.topLeftCorner<6, 6>();
  last_.distance_sigma = std::sqrt(std::max(0.0, covariance(9, 9)));
}

/// P <- F P F^T + Q for the motion T_last_c since the last pose, without the noise of the scale
/// error.
void MetricTrajectory::propagateMotion(const Eigen::Isometry3d& T_last_c,
                                       const ScaleEstimate& scale, double scale_correlation) {
  const Eigen::Matrix3d R_o_last = last_.T_o_c.linear();
  const Eigen::Vector3d step_o = R_o_last * T_last_c.translation() * scale.scale;
  const double length = step_o.norm();
  const double angle_variance = std::pow(options_.rotation_scale_sigma, 2);
  covariance_(7, 7) = angle_variance;  // stationary; zero before the first increment
  setVariance(8, heightVariance(scale));
  StateCovariance F = StateCovariance::Identity();
  F.block<3, 3>(0, 3) = -skew(step_o);
  F.block<3, 1>(0, 6) = F.block<3, 1>(0, 8) = step_o;
  F(9, 6) = F(9, 8) = length;
  F.block<3, 1>(3, 7) = R_o_last * rotationVector(T_last_c.linear());
  F(6, 6) = scale_correlation;
  F(7, 7) = std::exp(-length / options_.scale_correlation_m);
  covariance_ = F * covariance_ * F.transpose();
  covariance_(7, 7) = angle_variance;
  covariance_.block<3, 3>(0, 0) += directionCovariance(step_o);
  covariance_.block<3, 3>(3, 3) += rotationVariance(length) * Eigen::Matrix3d::Identity();
  const Matrix6d pose_noise =
      length / kPoseCorrelation * rotated(R_o_last * T_last_c.linear(), pose_covariance_c_);
  covariance_.topLeftCorner<6, 6>() += pose_noise;
  const Eigen::Vector3d along = step_o.normalized();
  covariance_(9, 9) += along.dot(pose_noise.topLeftCorner<3, 3>() * along);
}

/// The scale filter provides the variances of the errors of scale and camera height; only the
/// correlations are propagated here, so the row and column are rescaled to it.
void MetricTrajectory::setVariance(int state, double variance) {
  if (covariance_(state, state) > 0) {
    const double ratio = std::sqrt(variance / covariance_(state, state));
    covariance_.row(state) *= ratio;
    covariance_.col(state) *= ratio;
  } else {
    covariance_(state, state) = variance;
  }
}

/// Sets the twist: the constant one that leads to the motion T_last_c [VO units] in dt [s]; 0: not
/// known.
void MetricTrajectory::setTwist(const Eigen::Isometry3d& T_last_c, const ScaleEstimate& scale,
                                double dt) {
  Matrix6d& covariance = last_.twist_covariance;
  if (!(dt > 0)) {
    last_.twist_c.setZero();
    covariance = std::pow(kUnknownSpeedSigma, 2) * Matrix6d::Identity();
    velocity_c_.setZero();
    velocity_variance_ = covariance.topLeftCorner<3, 3>().trace();
    return;
  }
  Eigen::Isometry3d motion = T_last_c;
  motion.translation() *= scale.scale;
  last_.twist_c = meanTwist(motion, dt);
  const Eigen::Vector3d path_c = dt * last_.twist_c.head<3>();
  const Eigen::Vector3d rotation_c = dt * last_.twist_c.tail<3>();
  const double length = path_c.norm();
  const double share = std::min(length / kPoseCorrelation, 2.0);
  // The errors of the calibration, of which the rotation's random walk is the sum, are correlated,
  // so over a short distance they grow with its square.
  const double walk_share = std::min(length / (2 * options_.scale_correlation_m), 1.0);
  covariance = share * pose_covariance_c_;
  covariance.topLeftCorner<3, 3>() = stepCovariance(path_c, scale, share);
  covariance.bottomRightCorner<3, 3>() +=
      (walk_share * rotationVariance(length) + 2 * std::pow(kRotationNoise, 2)) *
          Eigen::Matrix3d::Identity() +
      std::pow(options_.rotation_scale_sigma, 2) * rotation_c * rotation_c.transpose();
  covariance /= dt * dt;

  // For a gap that may follow: in the axes of the camera now.
  const Eigen::Matrix3d R_c_last = T_last_c.linear().transpose();
  const Eigen::Vector3d step_c = scale.scale * (R_c_last * T_last_c.translation());
  Eigen::Vector3d steps_c = step_c;
  double steps_s = dt;
  if (last_step_s_ > 0 && areUnequal(dt, last_step_s_)) {
    steps_c += R_c_last * last_step_c_;
    steps_s += last_step_s_;
  }
  velocity_c_ = steps_c / steps_s;
  velocity_variance_ = stepCovariance(steps_c, scale).trace() / (steps_s * steps_s);
  last_step_c_ = step_c;
  last_step_s_ = dt;
}

/// Of a step [m] in camera axes, with the errors of the poses at both ends: of the map points'
/// reprojections, in which they differ by this share of the covariance of one pose (2: they are
/// independent), and a white noise.
Eigen::Matrix3d MetricTrajectory::stepCovariance(const Eigen::Vector3d& step_c,
                                                 const ScaleEstimate& scale,
                                                 double pose_share) const {
  const double noise = kPositionNoise * scale.height * scale.scale;
  return pose_share * pose_covariance_c_.topLeftCorner<3, 3>() + directionCovariance(step_c) +
         std::pow(scale.sigma / scale.scale, 2) * step_c * step_c.transpose() +
         2 * noise * noise * Eigen::Matrix3d::Identity();
}

/// Covariance of a step whose direction has an error: orthogonal to the step [m^2].
Eigen::Matrix3d MetricTrajectory::directionCovariance(const Eigen::Vector3d& step) const {
  return std::pow(options_.direction_sigma, 2) *
         (step.squaredNorm() * Eigen::Matrix3d::Identity() - step * step.transpose());
}

/// Variance of the rotation's random walk over a distance [rad^2].
double MetricTrajectory::rotationVariance(double length) const {
  return std::pow(options_.rotation_sigma_per_sqrt_m, 2) * length;
}

}  // namespace gsv
