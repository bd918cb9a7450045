#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <tf2_msgs/TFMessage.h>

#include <string>

#include "ground_scale_vo/ros/conversions.hpp"
#include "ros/odometry_output.hpp"

namespace gsv {

inline std_msgs::Header headerAt(const ros::Time& stamp, const std::string& frame_id = "camera") {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frame_id;
  return header;
}

inline geometry_msgs::TransformStamped transformBetween(const std::string& parent,
                                                        const std::string& child,
                                                        const Eigen::Isometry3d& T_parent_child) {
  nav_msgs::Odometry odometry;
  odometry.header.frame_id = parent;
  odometry.child_frame_id = child;
  odometry.pose.pose = toMsg(T_parent_child);
  return toTransformMsg(odometry);
}

/// Transform from a base frame to the frame "camera" at this position, looking ahead; pitch [rad],
/// positive: it looks down; yaw [rad], positive: to the left.
inline geometry_msgs::TransformStamped mounting(const std::string& base_frame,
                                                const Eigen::Vector3d& position, double pitch = 0,
                                                double yaw = 0) {
  Eigen::Isometry3d T_b_c(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * bodyFromOptical() *
                          Eigen::AngleAxisd(-pitch, Eigen::Vector3d::UnitX()));
  T_b_c.translation() = position;
  return transformBetween(base_frame, "camera", T_b_c);
}

/// As published on /tf at a time.
inline tf2_msgs::TFMessage tfMessage(const geometry_msgs::TransformStamped& transform,
                                     const ros::Time& stamp) {
  tf2_msgs::TFMessage message;
  message.transforms.push_back(transform);
  message.transforms[0].header.stamp = stamp;
  return message;
}

}  // namespace gsv
