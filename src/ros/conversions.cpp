#include "ground_scale_vo/ros/conversions.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <limits>

#include "ground_scale_vo/error.hpp"
#include "ground_scale_vo/finite.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1000000000;

template <typename Range>
bool allZero(const Range& values) {
  return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

DistortionModel toDistortionModel(const std::string& name, const std::string& subject) {
  if (name == sensor_msgs::distortion_models::PLUMB_BOB) return DistortionModel::kPlumbBob;
  if (name == sensor_msgs::distortion_models::RATIONAL_POLYNOMIAL) {
    return DistortionModel::kRationalPolynomial;
  }
  if (name == sensor_msgs::distortion_models::EQUIDISTANT || name == "fisheye") {
    return DistortionModel::kEquidistant;
  }
  throw MessageError(subject + " has the distortion model \"" + name +
                     "\"; known are plumb_bob, rational_polynomial and equidistant");
}

Eigen::Isometry3d toIsometry(const Eigen::Quaterniond& q, const Eigen::Vector3d& t) {
  if (!isFinite(q.coeffs()) || !isPlace(t)) {
    throw MessageError("the pose is not finite, or farther off than a camera can be");
  }
  if (std::abs(q.norm() - 1.0) > 0.01)
    throw MessageError("the pose's quaternion is not a unit one");
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() = t;
  return T;
}

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// Carries (linear, angular) small motions over to other axes (rotated by R) and to another point
/// of the same body, at `lever` from the old one in the old axes: v' = R (v + w x lever), w' = R w.
Matrix6d carry(const Eigen::Matrix3d& R, const Eigen::Vector3d& lever) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = R;
  J.topRightCorner<3, 3>() = -R * cross(lever);
  J.bottomRightCorner<3, 3>() = R;
  return J;
}

/// J C J', symmetric to the last bit.
template <typename Array>
void setCovariance(const Matrix6d& J, const Matrix6d& covariance, Array& array) {
  const Matrix6d carried = J * covariance * J.transpose();
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(array.data()) =
      0.5 * (carried + carried.transpose());
}

}  // namespace

std::int64_t toNanoseconds(const ros::Time& stamp) {
  return static_cast<std::int64_t>(stamp.sec) * kNanosecondsPerSecond +
         static_cast<std::int64_t>(stamp.nsec);
}

ros::Time fromNanoseconds(std::int64_t stamp_ns) {
  return ros::Time(static_cast<std::uint32_t>(stamp_ns / kNanosecondsPerSecond),
                   static_cast<std::uint32_t>(stamp_ns % kNanosecondsPerSecond));
}

cv::Mat toGrey(const sensor_msgs::Image& image) {
  namespace enc = sensor_msgs::image_encodings;
  if (image.width == 0 || image.height == 0) throw MessageError("the image has no pixels");

  std::size_t pixel_bytes = 0;
  try {
    pixel_bytes = static_cast<std::size_t>(enc::numChannels(image.encoding)) *
                  static_cast<std::size_t>(enc::bitDepth(image.encoding)) / 8;
  } catch (const std::exception&) {
    throw MessageError("the encoding \"" + image.encoding + "\" is not known");
  }
  const std::size_t step = image.step;
  if (step < image.width * pixel_bytes) {
    throw MessageError("the step of " + std::to_string(step) + " bytes is too short for " +
                       std::to_string(image.width) + " pixels of " + image.encoding);
  }
  if (image.data.size() != step * image.height) {
    throw MessageError("the image holds " + std::to_string(image.data.size()) +
                       " bytes instead of " + std::to_string(step * image.height));
  }

  try {
    cv_bridge::CvImage shared = *cv_bridge::toCvShare(image, nullptr);
    // One channel without a meaning is taken as brightness.
    if (shared.encoding == enc::TYPE_8UC1) shared.encoding = enc::MONO8;
    if (shared.encoding == enc::TYPE_16UC1) shared.encoding = enc::MONO16;
    if (shared.encoding == enc::MONO8) return shared.image;
    return cv_bridge::cvtColor(boost::make_shared<const cv_bridge::CvImage>(shared), enc::MONO8)
        ->image;
  } catch (const std::exception&) {
    throw MessageError("the encoding \"" + image.encoding + "\" cannot be turned into grey");
  }
}

bool operator==(const Calibration& a, const Calibration& b) {
  return a.raw.width == b.raw.width && a.raw.height == b.raw.height && a.raw.fx == b.raw.fx &&
         a.raw.fy == b.raw.fy && a.raw.cx == b.raw.cx && a.raw.cy == b.raw.cy &&
         a.model == b.model && a.coefficients == b.coefficients;
}

Calibration toCalibration(const sensor_msgs::CameraInfo& info, const std::string& topic,
                          bool image_is_rectified) {
  const std::string subject = "camera_info on topic " + topic;
  if (!areFinite(info.K, info.P, info.D)) {
    throw MessageError(subject + " has numbers that are not finite");
  }
  if (info.binning_x > 1 || info.binning_y > 1) {
    throw MessageError(subject + " has binning, which is not supported");
  }
  const bool whole_image =
      info.roi.width == 0 || (info.roi.width == info.width && info.roi.height == info.height);
  if (!whole_image || info.roi.x_offset != 0 || info.roi.y_offset != 0) {
    throw MessageError(subject + " has a region of interest, which is not supported");
  }
  const bool has_K = !allZero(info.K);
  const bool has_P = !allZero(info.P);
  if (!has_K && !has_P) {
    throw MessageError(subject + " is all zeros: the camera is not calibrated");
  }
  if (image_is_rectified && !has_P) {
    throw MessageError(subject + " has no P, which image_is_rectified needs");
  }

  Calibration calibration;
  PinholeCamera& raw = calibration.raw;
  raw.width = static_cast<int>(info.width);
  raw.height = static_cast<int>(info.height);
  if (image_is_rectified || !has_K) {
    raw.fx = info.P[0];
    raw.fy = info.P[5];
    raw.cx = info.P[2];
    raw.cy = info.P[6];
  } else {
    raw.fx = info.K[0];
    raw.fy = info.K[4];
    raw.cx = info.K[2];
    raw.cy = info.K[5];
    // Zero coefficients are no distortion, but for the fisheye, which bends without any.
    const bool unnamed = info.distortion_model.empty() && allZero(info.D);
    const DistortionModel model =
        unnamed ? DistortionModel::kNone : toDistortionModel(info.distortion_model, subject);
    if (model == DistortionModel::kEquidistant || !allZero(info.D)) {
      calibration.model = model;
      calibration.coefficients = info.D;
    }
  }
  return calibration;
}

Rectifier toRectifier(const Calibration& calibration, const std::string& topic) {
  try {
    calibration.raw.validate();
    return Rectifier(calibration.raw, calibration.model, calibration.coefficients);
  } catch (const OptionError& error) {
    throw MessageError("camera_info on topic " + topic + " cannot be used: " + error.what());
  }
}

sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera) {
  sensor_msgs::CameraInfo info;
  info.width = static_cast<std::uint32_t>(camera.width);
  info.height = static_cast<std::uint32_t>(camera.height);
  info.distortion_model = sensor_msgs::distortion_models::PLUMB_BOB;
  info.D.assign(5, 0.0);
  info.K = {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0};
  return info;
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
  msg->pose = toMsg(frame.T_w_c);

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
  const std::size_t size = msg.id.size();
  if (msg.age.size() != size) throw MessageError("the arrays id and age differ in length");
  for (const auto* array : {&msg.u, &msg.v, &msg.x, &msg.y, &msg.z, &msg.depth_sigma}) {
    if (array->size() != size) throw MessageError("the arrays of the features differ in length");
  }
  if (msg.status > VoFrameMsg::LOST) {
    throw MessageError("the status " + std::to_string(msg.status) + " is not known");
  }

  VoFrame frame;
  frame.stamp_ns = toNanoseconds(msg.header.stamp);
  frame.sequence = msg.sequence;
  frame.status = static_cast<VoStatus>(msg.status);
  frame.map_id = msg.map_id;
  frame.keyframe = msg.keyframe != 0;
  constexpr auto kGreatestSize = static_cast<std::uint32_t>(std::numeric_limits<int>::max());
  frame.camera.width = static_cast<int>(std::min(msg.width, kGreatestSize));
  frame.camera.height = static_cast<int>(std::min(msg.height, kGreatestSize));
  frame.camera.fx = msg.fx;
  frame.camera.fy = msg.fy;
  frame.camera.cx = msg.cx;
  frame.camera.cy = msg.cy;
  try {
    frame.camera.validate();
  } catch (const OptionError& error) {
    throw MessageError(std::string("the camera cannot be used: ") + error.what());
  }
  if (frame.status == VoStatus::kTracking) frame.T_w_c = fromMsg(msg.pose);

  frame.features.resize(size);
  for (std::size_t i = 0; i < size; ++i) {
    TrackedFeature& feature = frame.features[i];
    feature.id = msg.id[i];
    feature.age = msg.age[i];
    feature.u = {msg.u[i], msg.v[i]};
    if (i > 0 && feature.id <= msg.id[i - 1]) throw MessageError("the ids do not grow");
    if (!isPlace(feature.u)) throw MessageError("a feature's pixel is not finite");
    TrackedFeature with_point = feature;
    with_point.has_point = true;
    with_point.p_c = {msg.x[i], msg.y[i], msg.z[i]};
    with_point.depth_sigma = msg.depth_sigma[i];
    if (hasUsablePoint(with_point)) feature = with_point;
  }
  return frame;
}

ScaleEstimateMsg::Ptr toMsg(const ScaleEstimate& scale, std::uint32_t map_id,
                            const std_msgs::Header& header) {
  auto msg = boost::make_shared<ScaleEstimateMsg>();
  msg->header = header;
  msg->map_id = map_id;
  msg->status = static_cast<std::uint8_t>(scale.status);
  msg->reason = static_cast<std::uint8_t>(scale.reason);
  msg->raw_scale = scale.raw_scale;
  msg->scale = scale.scale;
  msg->sigma = scale.sigma;
  msg->height = scale.height;
  msg->normal.x = scale.n_c.x();
  msg->normal.y = scale.n_c.y();
  msg->normal.z = scale.n_c.z();
  msg->triangles = static_cast<std::uint32_t>(scale.triangles);
  msg->ground_triangles = static_cast<std::uint32_t>(scale.ground_triangles);
  msg->ground_points = static_cast<std::uint32_t>(scale.ground_points);
  msg->window_points = static_cast<std::uint32_t>(scale.window_points);
  msg->plane_inliers = static_cast<std::uint32_t>(scale.plane_inliers);
  return msg;
}

ScaleEstimate fromMsg(const ScaleEstimateMsg& msg) {
  if (msg.status > ScaleEstimateMsg::HELD || msg.reason > ScaleEstimateMsg::REJECTED_BY_FILTER) {
    throw MessageError("the status " + std::to_string(msg.status) + " or the reason " +
                       std::to_string(msg.reason) + " of the scale is not known");
  }
  ScaleEstimate scale;
  scale.status = static_cast<ScaleStatus>(msg.status);
  scale.reason = static_cast<ScaleReason>(msg.reason);
  scale.raw_scale = msg.raw_scale;
  scale.scale = msg.scale;
  scale.sigma = msg.sigma;
  scale.height = msg.height;
  scale.n_c = {msg.normal.x, msg.normal.y, msg.normal.z};
  scale.triangles = static_cast<int>(msg.triangles);
  scale.ground_triangles = static_cast<int>(msg.ground_triangles);
  scale.ground_points = static_cast<int>(msg.ground_points);
  scale.window_points = static_cast<int>(msg.window_points);
  scale.plane_inliers = static_cast<int>(msg.plane_inliers);
  return scale;
}

geometry_msgs::Pose toMsg(const Eigen::Isometry3d& T_a_b) {
  const Eigen::Quaterniond q(T_a_b.linear());
  geometry_msgs::Pose pose;
  pose.position.x = T_a_b.translation().x();
  pose.position.y = T_a_b.translation().y();
  pose.position.z = T_a_b.translation().z();
  pose.orientation.w = q.w();
  pose.orientation.x = q.x();
  pose.orientation.y = q.y();
  pose.orientation.z = q.z();
  return pose;
}

Eigen::Isometry3d fromMsg(const geometry_msgs::Pose& pose) {
  return toIsometry(
      {pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z},
      {pose.position.x, pose.position.y, pose.position.z});
}

Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform) {
  return toIsometry(
      {transform.rotation.w, transform.rotation.x, transform.rotation.y, transform.rotation.z},
      {transform.translation.x, transform.translation.y, transform.translation.z});
}

nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame) {
  auto msg = boost::make_shared<nav_msgs::Odometry>();
  msg->header.stamp = image_header.stamp;
  msg->header.frame_id = world_frame;
  msg->child_frame_id = image_header.frame_id;
  msg->pose.pose = toMsg(frame.T_w_c);
  return msg;
}

Eigen::Matrix3d bodyFromOptical() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return R;
}

OdometryFrames OdometryFrames::ofCamera(const std::string& odom_frame,
                                        const std::string& camera_frame) {
  OdometryFrames frames;
  frames.odom_frame = odom_frame;
  frames.base_frame = camera_frame;
  frames.T_odom_o.linear() = bodyFromOptical();
  return frames;
}

OdometryFrames OdometryFrames::ofBase(const std::string& odom_frame, const std::string& base_frame,
                                      const Eigen::Isometry3d& T_b_c) {
  OdometryFrames frames;
  frames.odom_frame = odom_frame;
  frames.base_frame = base_frame;
  frames.T_odom_o = T_b_c;
  frames.T_c_b = T_b_c.inverse();
  return frames;
}

nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const OdometryFrames& frames,
                                      const ros::Time& stamp) {
  const Eigen::Vector3d base_in_c = frames.T_c_b.translation();

  auto msg = boost::make_shared<nav_msgs::Odometry>();
  msg->header.stamp = stamp;
  msg->header.frame_id = frames.odom_frame;
  msg->child_frame_id = frames.base_frame;
  msg->pose.pose = toMsg(frames.T_odom_o * pose.T_o_c * frames.T_c_b);
  setCovariance(carry(frames.T_odom_o.linear(), pose.T_o_c.linear() * base_in_c), pose.covariance,
                msg->pose.covariance);

  const Matrix6d J = carry(frames.T_c_b.linear().transpose(), base_in_c);
  const Eigen::Matrix<double, 6, 1> twist_b = J * pose.twist_c;
  msg->twist.twist.linear.x = twist_b[0];
  msg->twist.twist.linear.y = twist_b[1];
  msg->twist.twist.linear.z = twist_b[2];
  msg->twist.twist.angular.x = twist_b[3];
  msg->twist.twist.angular.y = twist_b[4];
  msg->twist.twist.angular.z = twist_b[5];
  setCovariance(J, pose.twist_covariance, msg->twist.covariance);
  return msg;
}

geometry_msgs::TransformStamped toTransformMsg(const nav_msgs::Odometry& odometry) {
  geometry_msgs::TransformStamped transform;
  transform.header = odometry.header;
  transform.child_frame_id = odometry.child_frame_id;
  transform.transform.translation.x = odometry.pose.pose.position.x;
  transform.transform.translation.y = odometry.pose.pose.position.y;
  transform.transform.translation.z = odometry.pose.pose.position.z;
  transform.transform.rotation = odometry.pose.pose.orientation;
  return transform;
}

}  // namespace ground_scale_vo
