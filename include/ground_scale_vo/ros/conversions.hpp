#pragma once

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <ground_scale_vo/ScaleEstimate.h>
#include <ground_scale_vo/VoFrame.h>
#include <nav_msgs/Odometry.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

// Conversions between messages and the types of the core.
namespace gsv {

using VoFrameMsg = ground_scale_vo::VoFrame;
using ScaleEstimateMsg = ground_scale_vo::ScaleEstimate;
struct CameraInfo;  // input/camera_info.hpp

inline std::int64_t toNanoseconds(const ros::Time& stamp) {
  return static_cast<std::int64_t>(stamp.toNSec());
}
/// Precondition: 0 <= stamp_ns < 2^32 s.
inline ros::Time fromNanoseconds(std::int64_t stamp_ns) {
  return ros::Time().fromNSec(static_cast<std::uint64_t>(stamp_ns));
}

/// The name of a tf frame without leading slashes, which tf2 rejects, unlike tf.
std::string withoutLeadingSlashes(const std::string& frame);
/// The sentence that a frame name has leading slashes; empty: it has none. subject: what names it.
std::string leadingSlashWarning(const std::string& frame, const std::string& subject);

/// Exact except for the rotation, which a message holds as a quaternion: fromMsg(toMsg(x)) differs
/// from x by about 1e-16.
VoFrameMsg::Ptr toMsg(const VoFrame& frame, const std_msgs::Header& header);

/// Most features of a frame: the time of a frame grows with their number, about 0.2 s for this one.
constexpr std::size_t kMaxFeatures = 20000;

/// Any odometry may publish VoFrame, so every field is checked. Throws DataError. A point that
/// is not finite or not in front of the camera is dropped; its feature stays.
VoFrame fromMsg(const VoFrameMsg& msg);

ScaleEstimateMsg::Ptr toMsg(const ScaleEstimate& scale, std::uint32_t map_id,
                            const std_msgs::Header& header);
/// Throws DataError for an unknown status or reason.
ScaleEstimate fromMsg(const ScaleEstimateMsg& msg);

/// The up-to-scale pose of a tracked frame in world_frame, with its pose_covariance turned to the
/// axes of that frame. A covariance that is not known, as that of the twist, has -1 as its first
/// element.
nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame);

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_a_b);
/// Throws DataError for a position that is not plausible (isPlausiblePosition) or a quaternion
/// that is not of unit length.
Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose);
Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform);

/// Refers to the message's data.
RawImage fromMsg(const sensor_msgs::Image& image);

/// Copies the pixels. Precondition: 8 or 16 bits, continuous.
sensor_msgs::ImagePtr toMsg(const cv::Mat& pixels, const std::string& encoding,
                            const std_msgs::Header& header);

/// decodePixels(), without the plugin of image_transport, which Debian lacks. Throws DataError.
cv::Mat decode(const sensor_msgs::CompressedImage& image);

CameraInfo fromMsg(const sensor_msgs::CameraInfo& info);
/// camera_info of images with plumb_bob or no distortion.
sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& calibration);
sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera);

}  // namespace gsv
