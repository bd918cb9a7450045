#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/metric_trajectory.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// The up-to-scale pose of a tracked frame in world_frame, with its pose_covariance
/// turned to the axes of that frame. A covariance that is not known has -1 as
/// its first element, as in sensor_msgs/Imu: always that of the twist, which is not estimated.
nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame);

/// Rotation from optical axes (x right, y down, z forward) to body axes (x forward, y left, z up).
Eigen::Matrix3d bodyFromOptical();

/// The frames of the metric odometry: the pose of base_frame (b) in odom_frame.
struct OdometryFrames {
  std::string odom_frame;
  std::string base_frame;
  /// o is the core's metric frame, see MetricPose.
  Eigen::Isometry3d T_odom_o = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_c_b = Eigen::Isometry3d::Identity();
  /// Of the camera relative to the base, in camera axes: linear [m/s], then angular [rad/s].
  Vector6d mounting_twist_c = Vector6d::Zero();

  /// base_frame is the camera: odom has the origin of o, x forward, y left and z up.
  static OdometryFrames ofCamera(const std::string& odom_frame, const std::string& camera_frame);
  /// odom is the frame of the base whose camera coincides with o.
  static OdometryFrames ofBase(const std::string& odom_frame, const std::string& base_frame,
                               const Eigen::Isometry3d& T_b_c);
  /// The camera has moved on the base to T_b_c, in dt [s]. odom stays where it is.
  void moveMounting(const Eigen::Isometry3d& T_b_c, double dt);
};

/// Moves the origin of the metric poses to the first one after a reset, which is then exactly the
/// identity.
class PoseOrigin {
 public:
  /// The next pose is the origin.
  void moveToNextPose() {
    T_o_origin_.reset();
    waits_for_pose_ = true;
  }
  /// The origin is that of o again.
  void clear() {
    T_o_origin_.reset();
    waits_for_pose_ = false;
  }
  /// The pose relative to the origin. The covariance keeps what has accumulated since the first
  /// frame after the reset, so it is not zero at the origin.
  MetricPose relative(MetricPose pose);

 private:
  bool waits_for_pose_ = false;
  std::optional<Eigen::Isometry3d> T_o_origin_;  ///< empty: the origin is that of o
};

/// Pose of the base in odom with its covariance; twist of the base at its origin and in its axes
/// (REP-103, REP-105) with its covariance. The adjoint of the frames propagates the covariances.
nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const OdometryFrames& frames,
                                      const ros::Time& stamp);

/// The same pose for tf: header.frame_id -> child_frame_id.
geometry_msgs::TransformStamped toTransformMsg(const nav_msgs::Odometry& odometry);

}  // namespace ground_scale_vo
