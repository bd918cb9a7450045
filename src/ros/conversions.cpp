#include "ground_scale_vo/ros/conversions.hpp"

#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <limits>
#include <sstream>
#include <string_view>
#include <type_traits>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "input/camera_info.hpp"
#include "input/distortion_model.hpp"

namespace gsv {
namespace {

/// Largest deviation of the norm of a unit quaternion from 1: senders may round it.
constexpr double kUnitTolerance = 0.01;

template <typename... Parts>
[[noreturn]] void refuse(const Parts&... parts) {
  std::ostringstream sentence;
  (sentence << ... << parts);
  throw DataError(sentence.str());
}

/// "(1, 2, 3)"
template <typename Vector>
std::string text(const Vector& vector) {
  std::ostringstream stream;
  stream << vector.format(
      {Eigen::StreamPrecision, Eigen::DontAlignCols, ", ", ", ", "", "", "(", ")"});
  return stream.str();
}

/// Checks an enumerator of a message. Throws DataError.
void requireAtMost(const char* field, unsigned value, unsigned max) {
  if (value > max) refuse(field, " is ", value, ", it must lie in [0, ", max, "]");
}

/// name: of the quaternion, for the message of the error.
Eigen::Matrix3d toRotation(const geometry_msgs::Quaternion& msg, const std::string& name) {
  const Eigen::Quaterniond q(msg.w, msg.x, msg.y, msg.z);
  if (!(std::abs(q.norm() - 1.0) <= kUnitTolerance)) {
    refuse("the quaternion ", text(q.coeffs()), " of ", name,
           " is not of unit length: its norm is ", q.norm(), ", it must lie in [",
           1 - kUnitTolerance, ", ", 1 + kUnitTolerance, "]");
  }
  return q.normalized().toRotationMatrix();
}

/// position: a Point or a Vector3.
template <typename Position>
Eigen::Isometry3d toIsometry(const geometry_msgs::Quaternion& q, const Position& position) {
  const Eigen::Vector3d t(position.x, position.y, position.z);
  if (!isPlausiblePosition(t)) {
    refuse("the position ", text(t), " of the pose is not finite or beyond ", kLargestCoordinate);
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = toRotation(q, "the pose");
  T.translation() = t;
  return T;
}

using RowMajorMatrix6d = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

/// First element of a covariance without an estimate, as sensor_msgs/Imu defines it; nav_msgs and
/// geometry_msgs define none.
constexpr double kUnknownCovariance = -1;
/// Of a focal length: no lens has more.
constexpr double kMaxZoom = 1000;

Matrix6d poseCovarianceOf(const VoFrameMsg& msg) {
  const Eigen::Map<const RowMajorMatrix6d> C(msg.pose_covariance.data());
  if (C(0, 0) <= 0) return Matrix6d::Zero();  // not known
  if (!isFinite(C) || C.diagonal().minCoeff() < 0 || !C.isApprox(C.transpose(), 1e-6)) {
    refuse("pose_covariance is not finite, symmetric and positive on its diagonal");
  }
  return C;
}

MapStart mapStartOf(const VoFrameMsg& msg) {
  MapStart start;
  if (msg.map_start.isZero()) return start;
  if (msg.map_start > msg.header.stamp) {
    refuse("map_start is ", msg.map_start, " s, later than the stamp of the frame, ",
           msg.header.stamp, " s");
  }
  start.stamp_ns = toNanoseconds(msg.map_start);
  if (!isFinite(msg.map_start_rotation_sigma) || msg.map_start_rotation_sigma < 0) return start;
  start.R_previous_w = toRotation(msg.map_start_rotation, "map_start_rotation");
  start.rotation_sigma = msg.map_start_rotation_sigma;
  return start;
}

void requireEqualSizes(const VoFrameMsg& msg) {
  const std::size_t size = msg.id.size();
  if (size > kMaxFeatures) {
    refuse("the frame has ", size, " features; at most ", kMaxFeatures, " are accepted");
  }
  const std::pair<const char*, std::size_t> sizes[] = {{"age", msg.age.size()},
                                                       {"u", msg.u.size()},
                                                       {"v", msg.v.size()},
                                                       {"x", msg.x.size()},
                                                       {"y", msg.y.size()},
                                                       {"z", msg.z.size()},
                                                       {"depth_sigma", msg.depth_sigma.size()}};
  for (const auto& [name, elements] : sizes) {
    if (elements != size) refuse(name, " has ", elements, " elements, but id has ", size);
  }
}

PinholeCamera cameraOf(const VoFrameMsg& msg) {
  constexpr auto kMaxSize = static_cast<std::uint32_t>(std::numeric_limits<int>::max());
  const PinholeCamera camera{static_cast<int>(std::min(msg.width, kMaxSize)),
                             static_cast<int>(std::min(msg.height, kMaxSize)),
                             msg.fx,
                             msg.fy,
                             msg.cx,
                             msg.cy,
                             msg.lens_is_estimated != 0,
                             msg.k1_sigma};
  try {
    camera.validate();
  } catch (const OptionError& error) {
    refuse("camera intrinsics or image size of the frame are invalid: ", error.what());
  }
  return camera;
}

/// Precondition: i is 0, or the features before it were accepted.
TrackedFeature featureOf(const VoFrameMsg& msg, std::size_t i) {
  TrackedFeature feature;
  feature.id = msg.id[i];
  feature.age = msg.age[i];
  feature.u = {msg.u[i], msg.v[i]};
  if (i > 0 && feature.id <= msg.id[i - 1]) {
    refuse("the ids are not in ascending order: id[", i, "] is ", feature.id, " after ",
           msg.id[i - 1]);
  }
  if (!isPlausiblePosition(feature.u)) {
    refuse("feature ", feature.id, " has the pixel ", text(feature.u),
           ", which is not finite or beyond ", kLargestCoordinate);
  }
  TrackedFeature with_point = feature;
  with_point.has_point = true;
  with_point.p_c = {msg.x[i], msg.y[i], msg.z[i]};
  with_point.depth_sigma = msg.depth_sigma[i];
  return hasUsablePoint(with_point) ? with_point : feature;
}

/// Each field of a ScaleEstimate with that of its message.
template <typename Estimate, typename Message, typename Visit>
void visitFields(Estimate& scale, Message& msg, Visit&& visit) {
  visit(scale.status, msg.status);
  visit(scale.measurement, msg.reason);
  visit(scale.raw_scale, msg.raw_scale);
  visit(scale.scale, msg.scale);
  visit(scale.sigma, msg.sigma);
  visit(scale.height, msg.height);
  visit(scale.source, msg.source);
  visit(scale.camera_height, msg.camera_height);
  visit(scale.camera_height_sigma, msg.camera_height_sigma);
  visit(scale.n_c.x(), msg.normal.x);
  visit(scale.n_c.y(), msg.normal.y);
  visit(scale.n_c.z(), msg.normal.z);
  visit(scale.triangles, msg.triangles);
  visit(scale.ground_triangles, msg.ground_triangles);
  visit(scale.ground_points, msg.ground_points);
  visit(scale.window_points, msg.window_points);
  visit(scale.plane_inliers, msg.plane_inliers);
}

}  // namespace

std::string withoutLeadingSlashes(const std::string& frame) {
  const std::size_t first = frame.find_first_not_of('/');
  return first == std::string::npos ? std::string() : frame.substr(first);
}

std::string leadingSlashWarning(const std::string& frame, const std::string& subject) {
  const std::string name = withoutLeadingSlashes(frame);
  if (name == frame) return {};
  return subject + " is \"" + frame + "\"; tf2 has no leading slash, \"" + name + "\" is used";
}

VoFrameMsg::Ptr toMsg(const VoFrame& frame, const std_msgs::Header& header) {
  auto msg = boost::make_shared<VoFrameMsg>();
  msg->header = header;
  msg->sequence = frame.sequence;
  msg->status = static_cast<std::uint8_t>(frame.status);
  msg->map_id = frame.map_id;
  msg->keyframe = frame.keyframe;
  msg->width = static_cast<std::uint32_t>(frame.camera.width);
  msg->height = static_cast<std::uint32_t>(frame.camera.height);
  msg->fx = frame.camera.fx;
  msg->fy = frame.camera.fy;
  msg->cx = frame.camera.cx;
  msg->cy = frame.camera.cy;
  msg->lens_is_estimated = frame.camera.lens_is_estimated;
  msg->k1_sigma = frame.camera.k1_sigma;
  msg->zoom = frame.zoom;
  msg->pose = tf2::toMsg(frame.T_w_c);
  Eigen::Map<RowMajorMatrix6d>(msg->pose_covariance.data()) = frame.pose_covariance;
  std::copy_n(frame.readout_motion.data(), 6, msg->readout_motion.begin());
  msg->map_start = fromNanoseconds(frame.map_start.stamp_ns);
  msg->map_start_rotation = tf2::toMsg(Eigen::Quaterniond(frame.map_start.R_previous_w));
  msg->map_start_rotation_sigma = frame.map_start.rotation_sigma;

  const std::size_t size = frame.features.size();
  for (auto* array : {&msg->u, &msg->v, &msg->x, &msg->y, &msg->z, &msg->depth_sigma}) {
    array->reserve(size);
  }
  msg->id.reserve(size);
  msg->age.reserve(size);
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (const TrackedFeature& feature : frame.features) {
    msg->id.push_back(feature.id);
    msg->age.push_back(feature.age);
    msg->u.push_back(feature.u.x());
    msg->v.push_back(feature.u.y());
    msg->x.push_back(feature.has_point ? feature.p_c.x() : kNone);
    msg->y.push_back(feature.has_point ? feature.p_c.y() : kNone);
    msg->z.push_back(feature.has_point ? feature.p_c.z() : kNone);
    msg->depth_sigma.push_back(feature.has_point ? feature.depth_sigma : kNone);
  }
  return msg;
}

VoFrame fromMsg(const VoFrameMsg& msg) {
  requireEqualSizes(msg);
  requireAtMost("status", msg.status, VoFrameMsg::LOST);
  VoFrame frame;
  frame.stamp_ns = toNanoseconds(msg.header.stamp);
  frame.sequence = msg.sequence;
  frame.status = static_cast<VoStatus>(msg.status);
  frame.map_id = msg.map_id;
  frame.keyframe = msg.keyframe != 0;
  frame.camera = cameraOf(msg);
  if (!(msg.zoom >= 0 && msg.zoom <= kMaxZoom)) refuse("zoom is ", msg.zoom);
  if (msg.zoom > 0) frame.zoom = msg.zoom;
  if (frame.status == VoStatus::kTracking) {
    frame.T_w_c = fromMsg(msg.pose);
    frame.pose_covariance = poseCovarianceOf(msg);
    frame.readout_motion = Eigen::Map<const Vector6d>(msg.readout_motion.data());
    if (!isPlausiblePosition(frame.readout_motion)) {
      refuse("the readout_motion ", text(frame.readout_motion), " is not finite or beyond ",
             kLargestCoordinate);
    }
  }
  frame.map_start = mapStartOf(msg);
  frame.features.reserve(msg.id.size());
  for (std::size_t i = 0; i < msg.id.size(); ++i) frame.features.push_back(featureOf(msg, i));
  return frame;
}

ScaleEstimateMsg::Ptr toMsg(const ScaleEstimate& scale, std::uint32_t map_id,
                            const std_msgs::Header& header) {
  auto msg = boost::make_shared<ScaleEstimateMsg>();
  msg->header = header;
  msg->map_id = map_id;
  visitFields(scale, *msg, [](const auto& value, auto& field) {
    field = static_cast<std::decay_t<decltype(field)>>(value);
  });
  return msg;
}

ScaleEstimate fromMsg(const ScaleEstimateMsg& msg) {
  requireAtMost("status", msg.status, ScaleEstimateMsg::HELD);
  requireAtMost("reason", msg.reason, ScaleEstimateMsg::ZOOMED);
  requireAtMost("source", msg.source, ScaleEstimateMsg::SOURCE_BOTH);
  ScaleEstimate scale;
  visitFields(scale, msg, [](auto& value, const auto& field) {
    value = static_cast<std::decay_t<decltype(value)>>(field);
  });
  return scale;
}

nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame) {
  auto msg = boost::make_shared<nav_msgs::Odometry>();
  msg->header.stamp = image_header.stamp;
  msg->header.frame_id = world_frame;
  msg->child_frame_id = image_header.frame_id;
  msg->pose.pose = tf2::toMsg(frame.T_w_c);
  Matrix6d axes = Matrix6d::Zero();
  axes.topLeftCorner<3, 3>() = axes.bottomRightCorner<3, 3>() = frame.T_w_c.linear();
  const Matrix6d covariance = axes * frame.pose_covariance * axes.transpose();
  Eigen::Map<RowMajorMatrix6d>(msg->pose.covariance.data()) =
      0.5 * (covariance + covariance.transpose());
  if (frame.pose_covariance.isZero(0)) msg->pose.covariance[0] = kUnknownCovariance;
  msg->twist.covariance[0] = kUnknownCovariance;
  return msg;
}

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_a_b) { return tf2::toMsg(T_a_b); }

Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose) {
  return toIsometry(pose.orientation, pose.position);
}

Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform) {
  return toIsometry(transform.rotation, transform.translation);
}

RawImage fromMsg(const sensor_msgs::Image& image) {
  return {image.height, image.width,       image.encoding,   image.is_bigendian != 0,
          image.step,   image.data.data(), image.data.size()};
}

sensor_msgs::ImagePtr toMsg(const cv::Mat& pixels, const std::string& encoding,
                            const std_msgs::Header& header) {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->header = header;
  image->height = static_cast<std::uint32_t>(pixels.rows);
  image->width = static_cast<std::uint32_t>(pixels.cols);
  image->encoding = encoding;
  image->step = static_cast<std::uint32_t>(pixels.cols * pixels.elemSize());
  image->data.assign(pixels.datastart, pixels.dataend);
  return image;
}

cv::Mat decode(const sensor_msgs::CompressedImage& image) {
  const std::string_view bytes(reinterpret_cast<const char*>(image.data.data()), image.data.size());
  try {
    return decodePixels(bytes);
  } catch (const DataError& error) {
    throw DataError("the compressed image (format \"" + image.format + "\", " +
                    std::to_string(bytes.size()) + " bytes) " + error.what());
  }
}

CameraInfo fromMsg(const sensor_msgs::CameraInfo& msg) {
  CameraInfo info;
  info.height = msg.height;
  info.width = msg.width;
  info.distortion_model = msg.distortion_model;
  info.D = msg.D;
  std::copy(msg.K.begin(), msg.K.end(), info.K.begin());
  std::copy(msg.R.begin(), msg.R.end(), info.R.begin());
  std::copy(msg.P.begin(), msg.P.end(), info.P.begin());
  info.binning_x = msg.binning_x;
  info.binning_y = msg.binning_y;
  info.roi = {msg.roi.x_offset, msg.roi.y_offset, msg.roi.height, msg.roi.width};
  return info;
}

sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& c) {
  sensor_msgs::CameraInfo info;
  info.width = static_cast<std::uint32_t>(c.width);
  info.height = static_cast<std::uint32_t>(c.height);
  info.distortion_model = c.model->names.front();
  info.D = c.distortion;
  if (c.isPlumbBob()) info.D.resize(5);
  info.K = {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0};
  return info;
}

sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera) {
  return toCameraInfo(withoutDistortion(camera));
}

}  // namespace gsv
