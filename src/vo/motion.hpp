#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "vo/feature.hpp"
#include "vo/map.hpp"

namespace gsv {

/// The pose of the last tracked frame and the constant-velocity prediction of the next one.
class MotionModel {
 public:
  MotionModel() = default;
  /// Starts at a pose, without a velocity.
  explicit MotionModel(const StampedPose& start) : pose_(start) {}

  const Eigen::Isometry3d& T_w_c() const { return pose_.T_w_c; }
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
  void update(const StampedPose& pose);

  /// Moves the last pose by a correction of the map in the axes of w (Mapping::applyAdjustment());
  /// the velocity is unchanged.
  void correct(const Eigen::Isometry3d& correction) { pose_.T_w_c = correction * pose_.T_w_c; }

 private:
  StampedPose pose_;
  Vector6d velocity_ = Vector6d::Zero();  ///< (w, v) in the axes of c [rad/s, VO units/s]
  double rotation_rate_change_ = 0;
  double velocity_dt_ = 0;  ///< interval over which it was measured [s]
  /// The same over the last two intervals when these differ much in length.
  Vector6d long_velocity_ = Vector6d::Zero();
  double long_dt_ = 0;
};

/// Predicts the pixel of each feature of a camera at T_w_previous in a camera at T_w_next [px]: the
/// projection of its map point or, without a map point, of a point at the median inverse depth of
/// the map points around it.
std::vector<cv::Point2f> predictPixels(const PinholeCamera& camera, const LocalMap& map,
                                       const std::vector<Feature>& features,
                                       const Eigen::Isometry3d& T_w_previous,
                                       const Eigen::Isometry3d& T_w_next);

/// Prediction without a map: each feature continues with its flow. dt: [s].
std::vector<cv::Point2f> predictPixelsByFlow(const std::vector<Feature>& features, double dt);

/// Sets Feature::to_stamp of the features in a camera at T_w_c, from the depths that
/// predictPixels() uses. readout_motion: see VoFrame; readout_angle_sigma: standard deviation of
/// its rotation [rad].
void shiftFeatures(const PinholeCamera& camera, const LocalMap& map, const Eigen::Isometry3d& T_w_c,
                   const Vector6d& readout_motion, double readout_angle_sigma,
                   std::vector<Feature>* features);

/// The same for all observations of map points by keyframes, with the depths that are known now.
void shiftObservations(const PinholeCamera& camera, LocalMap* map);

/// The same without a map, by the flow. First corrects the flow for the time between the exposures
/// of the feature's rows in both images. dt: between their stamps [s].
void shiftFeaturesByFlow(const PinholeCamera& camera, double readout_time, double dt,
                         std::vector<Feature>* features);

}  // namespace gsv
