#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <string>

#include "ground_scale_vo/scale/metric_trajectory.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// The up-to-scale pose of a tracked frame in world_frame. Covariances and twist are zero: their
/// units are not metric.
nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame);

/// Rotation from optical axes (x right, y down, z forward) to body axes (x forward, y left, z up).
Eigen::Matrix3d bodyFromOptical();

/// The frames between which the metric odometry is published: b from odom.
struct OdometryFrames {
  std::string odom_frame;
  std::string base_frame;
  /// o is the core's metric frame, see MetricPose.
  Eigen::Isometry3d T_odom_o = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_c_b = Eigen::Isometry3d::Identity();

  /// base_frame is the camera: odom has the origin of o, x forward, y left and z up.
  static OdometryFrames ofCamera(const std::string& odom_frame, const std::string& camera_frame);
  /// odom is the frame of the base whose camera coincides with o.
  static OdometryFrames ofBase(const std::string& odom_frame, const std::string& base_frame,
                               const Eigen::Isometry3d& T_b_c);
};

/// Pose of the base in odom with its covariance; twist of the base at its origin and in its axes
/// (REP-103, REP-105) with its covariance. The adjoint of the frames propagates the covariances.
nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const OdometryFrames& frames,
                                      const ros::Time& stamp);

/// The same pose for tf: header.frame_id -> child_frame_id.
geometry_msgs::TransformStamped toTransformMsg(const nav_msgs::Odometry& odometry);

}  // namespace ground_scale_vo
