#pragma once

#include <geometry_msgs/TransformStamped.h>

#include <string>

#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {

/// Where the frame "camera" is on a base: there, looking ahead.
inline geometry_msgs::TransformStamped mounting(const std::string& base_frame,
                                                const Eigen::Vector3d& place) {
  Eigen::Isometry3d T_b_c(bodyFromOptical());
  T_b_c.translation() = place;
  nav_msgs::Odometry mounting;
  mounting.header.frame_id = base_frame;
  mounting.child_frame_id = "camera";
  mounting.pose.pose = toMsg(T_b_c);
  return toTransformMsg(mounting);
}

}  // namespace ground_scale_vo
