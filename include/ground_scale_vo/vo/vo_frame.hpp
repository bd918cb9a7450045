#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <vector>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

enum class VoStatus : std::uint8_t { kInitialising = 0, kTracking = 1, kLost = 2 };

inline const char* toString(VoStatus status) {
  switch (status) {
    case VoStatus::kInitialising:
      return "initialising";
    case VoStatus::kTracking:
      return "tracking";
    case VoStatus::kLost:
      return "lost";
  }
  return "invalid";
}

/// How a frame continues the frames before it. Decided once, and passed down to the stages: by
/// VisualOdometry (kNewMap) and SelfCalibratingOdometry (kOtherLens) for their own frames, by
/// FrameContinuity (ros/) for received ones, from their ids. ScaleRecovery alone may raise it, when
/// the pose jumps within a map.
enum class Continuity : std::uint8_t {
  kSameMap,         ///< pose and unit of length continue
  kOtherLens,       ///< the same, with images of a better lens from this frame on
  kNewMapSameUnit,  ///< the pose does not continue, the unit of length does
  kNewMap,          ///< neither does; the rotation to it may be known (MapStart)
  kNewTrajectory    ///< nothing before this frame counts
};

/// One tracked corner of one frame.
struct TrackedFeature {
  std::uint64_t id = 0;  ///< constant while the corner is tracked; never reused
  /// Number of earlier frames in which it was tracked; a standstill counts as one.
  std::uint32_t age = 0;
  /// [px] in the rectified image; with a rolling shutter, where it would be seen at the stamp.
  Eigen::Vector2f u = Eigen::Vector2f::Zero();
  bool has_point = false;  ///< p_c and depth_sigma are valid
  /// 3-D map point in the camera frame of this frame, VO units. z > 0.
  Eigen::Vector3f p_c = Eigen::Vector3f::Zero();
  float depth_sigma = 0.f;  ///< standard deviation of p_c.z given the poses, VO units
};

/// Whether the feature has a point, which is finite and in front of the camera, and a finite sigma.
inline bool hasUsablePoint(const TrackedFeature& feature) {
  return feature.has_point && isPlausiblePosition(feature.p_c) && feature.p_c.z() > 0 &&
         feature.depth_sigma >= 0 && feature.depth_sigma <= kLargestCoordinate;
}

/// Relation of a map to the motion before it, for the metric trajectory. The default value means
/// unknown, for example with another odometry.
struct MapStart {
  std::int64_t stamp_ns = 0;  ///< [ns] of the map's first frame; 0: unknown, as is the rotation
  /// Rotation of the map's world frame w, which is the camera at the map's first frame, against the
  /// camera at the last frame with a pose before it; in the first map against the first image of
  /// the drive. x_previous = R_previous_w x_w.
  Eigen::Matrix3d R_previous_w = Eigen::Matrix3d::Identity();
  /// Standard deviation per axis [rad]; infinite: the rotation is unknown.
  double rotation_sigma = std::numeric_limits<double>::infinity();
};

/// Output of the visual odometry and input of the scale stage: the pose of one frame and its
/// tracked features with their 3-D points, up to scale. msg/VoFrame.msg is the same as a ROS
/// message, so any monocular odometry can provide it.
struct VoFrame {
  std::int64_t stamp_ns = 0;   ///< [ns] of the image
  std::uint32_t sequence = 0;  ///< number of the image, counted by the odometry from 0
  VoStatus status = VoStatus::kInitialising;
  std::uint32_t map_id = 0;  ///< increases by one with each new map; VO units differ between maps
  Continuity continuity = Continuity::kSameMap;  ///< of a lost frame kNewTrajectory or not used
  bool keyframe = false;
  PinholeCamera camera;
  /// Factor by which the focal length of the images has changed since the start: with another one
  /// than 1 the camera is not that of its calibration, and lengths cannot be metric.
  double zoom = 1;
  /// Pose in the map's world frame, whose origin is the map's first frame (camera axes).
  /// VO units. Valid only while status is kTracking.
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
  /// Covariance of T_w_c relative to the map points, without the drift of the map: position [VO
  /// units], then rotation [rad], both of a small motion in camera axes (the order of
  /// geometry_msgs/PoseWithCovariance). Zero: not known. Valid only while status is kTracking.
  Matrix6d pose_covariance = Matrix6d::Zero();
  /// Motion of the camera (w, v) during the readout of a rolling shutter, which exposes row v at
  /// boxplus(T_w_c, camera.readoutShare(v) * readout_motion). Zero: a global shutter.
  Vector6d readout_motion = Vector6d::Zero();
  /// The same in all frames of a map from its start on; unknown while kInitialising.
  MapStart map_start;
  std::vector<TrackedFeature> features;  ///< ordered by id
};

/// Multiplies all lengths of the frame, as for another unit.
inline void scaleLengths(double factor, VoFrame* frame) {
  frame->T_w_c.translation() *= factor;
  frame->pose_covariance = withScaledPosition(frame->pose_covariance, factor);
  frame->readout_motion.tail<3>() *= factor;
  for (TrackedFeature& feature : frame->features) {
    feature.p_c *= static_cast<float>(factor);
    feature.depth_sigma *= static_cast<float>(factor);
  }
}

}  // namespace gsv
