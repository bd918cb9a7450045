#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/messages.hpp"
#include "ground_scale_vo/scale/metric_trajectory.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/camera.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

/// The only place where messages and core types meet.
namespace ground_scale_vo {

/// A message that cannot be used. what() is one sentence that says why.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

std::int64_t toNanoseconds(const ros::Time& stamp);
/// Precondition: 0 <= stamp_ns < 2^32 s.
ros::Time fromNanoseconds(std::int64_t stamp_ns);

/// Turns images into 8-bit grey, from every encoding that has brightness: mono, colour and Bayer of
/// 8 or 16 bits, yuv422.
///
/// Of 16 bits most cameras use fewer. The scale is taken from the bits that are in use (8, 10, 12,
/// 14 or 16): at first those of the first image, more when a brighter one comes, never fewer. So
/// the brightness does not flicker, and an image does not depend on the ones after it.
class GreyConverter {
 public:
  /// Of an 8-bit mono image the pixels are the message's own, which must outlive them. Throws
  /// MessageError: no pixels, an encoding that has no grey, a step that does not fit the width,
  /// data shorter or longer than step * height.
  cv::Mat convert(const sensor_msgs::Image& image);

 private:
  cv::Mat toEightBits(const cv::Mat& grey);

  int bits_ = 8;  ///< in use
};

/// What a CameraInfo says of the images beside it.
struct Calibration {
  PinholeCamera raw;  ///< of the images as they come
  DistortionModel model = DistortionModel::kNone;
  std::vector<double> coefficients;  ///< empty for kNone
};
bool operator==(const Calibration& a, const Calibration& b);

/// K and D; P when K is all zero, as for a rectified camera, or when image_is_rectified says that
/// the images are rectified although K and D describe the raw camera. roi and binning are applied.
/// R and the last column of P are not used: the motion is that of the camera as it is mounted.
/// Throws MessageError, which names the topic: nothing calibrated (K and P all zero), a number not
/// finite, a matrix that is no camera's, an unknown distortion model, a roi outside the image.
Calibration toCalibration(const sensor_msgs::CameraInfo& info, const std::string& topic,
                          bool image_is_rectified);

/// Throws MessageError, which names the topic: a wrong number of coefficients.
Rectifier toRectifier(const Calibration& calibration, const std::string& topic);

/// The camera alone: no distortion, K and P filled, D zero. For writing bags.
sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera);

/// Exact, but for the rotation, which passes through a unit quaternion (fromMsg(toMsg(x)) differs
/// from x by some 1e-16, and not at all when x came from a message).
VoFrameMsg::Ptr toMsg(const VoFrame& frame, const std_msgs::Header& header);

/// Throws MessageError when another odometry filled the message wrongly: arrays of different
/// length, ids that do not grow, pixels that are not finite, no camera, an unknown status, or a
/// pose that is none although status is TRACKING. A point that is not finite, or not in front of
/// the camera, counts as none.
VoFrame fromMsg(const VoFrameMsg& msg);

ScaleEstimateMsg::Ptr toMsg(const ScaleEstimate& scale, std::uint32_t map_id,
                            const std_msgs::Header& header);
/// Throws MessageError when the status or reason is not known.
ScaleEstimate fromMsg(const ScaleEstimateMsg& msg);

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_a_b);
/// Throws MessageError when the position is no place (isPlace) or the quaternion not a unit one.
Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose);
Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform);

/// The up-to-scale pose of a tracking frame; covariances and twist are zero: they have no unit.
nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame);

/// From camera axes (x right, y down, z forward) to body axes (x forward, y left, z up).
Eigen::Matrix3d bodyFromOptical();

/// How the camera's motion is told: odom_frame, and the frame whose pose is published.
struct OdometryFrames {
  std::string odom_frame;
  std::string base_frame;
  /// o, the core's metric frame at the first camera, seen from odom.
  Eigen::Isometry3d T_odom_o = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_c_b = Eigen::Isometry3d::Identity();

  /// The camera's own pose: odom has its origin at the first camera, x forward and z up there.
  static OdometryFrames ofCamera(const std::string& odom_frame, const std::string& camera_frame);
  /// The pose of a base: odom is the base frame at the first image.
  static OdometryFrames ofBase(const std::string& odom_frame, const std::string& base_frame,
                               const Eigen::Isometry3d& T_b_c);
};

/// Pose and its covariance in odom, of the base; twist and its covariance in the base's axes and at
/// its origin (REP-103, REP-105). Covariances are carried over by the adjoint of the frames.
nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const OdometryFrames& frames,
                                      const ros::Time& stamp);

/// The transform that an odometry states, for tf.
geometry_msgs::TransformStamped toTransformMsg(const nav_msgs::Odometry& odometry);

}  // namespace ground_scale_vo
