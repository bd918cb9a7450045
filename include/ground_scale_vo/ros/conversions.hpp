#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>

#include "ground_scale_vo/ros/message_error.hpp"
#include "ground_scale_vo/ros/messages.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

// Conversions between messages and the types of the core.
namespace ground_scale_vo {

std::int64_t toNanoseconds(const ros::Time& stamp);
/// Precondition: 0 <= stamp_ns < 2^32 s.
ros::Time fromNanoseconds(std::int64_t stamp_ns);

/// Exact except for the rotation, which a message holds as a quaternion: fromMsg(toMsg(x)) differs
/// from x by about 1e-16.
VoFrameMsg::Ptr toMsg(const VoFrame& frame, const std_msgs::Header& header);

/// Most features of a frame: the time of a frame grows with their number, about 0.2 s for this one.
constexpr std::size_t kMaxFeatures = 20000;

/// Any odometry may publish VoFrame, so the message is checked. Throws MessageError: more than
/// kMaxFeatures features, arrays of
/// different lengths, ids not in ascending order, pixels that are not finite, an invalid camera or
/// status, an invalid pose although status is TRACKING, or an invalid map_start. A point that is
/// not finite or not in front of the camera is dropped; its feature stays.
VoFrame fromMsg(const VoFrameMsg& msg);

ScaleEstimateMsg::Ptr toMsg(const ScaleEstimate& scale, std::uint32_t map_id,
                            const std_msgs::Header& header);
/// Throws MessageError for an unknown status or reason.
ScaleEstimate fromMsg(const ScaleEstimateMsg& msg);

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_a_b);
/// Throws MessageError for a position that is not plausible (isPlausiblePosition) or a quaternion
/// that is not of unit length.
Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose);
Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform);

}  // namespace ground_scale_vo
