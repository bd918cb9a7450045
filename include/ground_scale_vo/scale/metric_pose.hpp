#pragma once

#include <Eigen/Geometry>

#include "ground_scale_vo/common/se3.hpp"

namespace gsv {

/// Camera pose in metres. The odometry frame o has the axes of the camera (x right, y down, z
/// forward). Its origin is the first frame of the first map with a scale. Its axes are the axes of
/// the camera at the first image if the odometry knows the rotation from there to its maps
/// (MapStart), otherwise at the origin.
struct MetricPose {
  Eigen::Isometry3d T_o_c = Eigen::Isometry3d::Identity();
  /// Accumulated covariance of T_o_c in o axes, in the order of geometry_msgs/PoseWithCovariance:
  /// position [m^2], then rotation as a left perturbation exp(w) R [rad^2].
  Matrix6d covariance = Matrix6d::Zero();
  /// The constant twist, in camera axes c, that leads here from the previous tracked frame of the
  /// map (in its first tracked frame from the map's first frame): linear [m/s], then angular
  /// [rad/s]; the logarithm of the motion in SE(3) over its duration. Zero with a standard
  /// deviation of 50 m/s and rad/s when no such frame is known.
  Vector6d twist_c = Vector6d::Zero();
  Matrix6d twist_covariance = Matrix6d::Zero();
  double distance = 0;  ///< travelled so far [m]
  /// Standard deviation of distance [m]: the errors are summed along the path, also of a loop.
  double distance_sigma = 0;
};

}  // namespace gsv
