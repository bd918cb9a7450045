#include "ground_scale_vo/ros/conversions.hpp"

#include <sensor_msgs/distortion_models.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1000000000;

/// Greatest side of an image [px] and most pixels, so that their product and the memory behind it
/// stay sane whatever a message says.
constexpr std::uint32_t kMaxSide = 100000;
constexpr double kMaxPixels = 1e8;

constexpr int kIsGrey = -1;
struct Encoding {
  std::string_view name;
  int depth, channels;
  int to_grey;  ///< cv::ColorConversionCodes or kIsGrey
};
/// Channels without a meaning are taken as OpenCV has them: one is brightness, three or four are
/// blue, green, red (and opacity). OpenCV names Bayer patterns by their second row.
constexpr Encoding kEncodings[] = {
    {"mono8", CV_8U, 1, kIsGrey},
    {"8UC1", CV_8U, 1, kIsGrey},
    {"bgr8", CV_8U, 3, cv::COLOR_BGR2GRAY},
    {"8UC3", CV_8U, 3, cv::COLOR_BGR2GRAY},
    {"rgb8", CV_8U, 3, cv::COLOR_RGB2GRAY},
    {"bgra8", CV_8U, 4, cv::COLOR_BGRA2GRAY},
    {"8UC4", CV_8U, 4, cv::COLOR_BGRA2GRAY},
    {"rgba8", CV_8U, 4, cv::COLOR_RGBA2GRAY},
    {"bayer_rggb8", CV_8U, 1, cv::COLOR_BayerBG2GRAY},
    {"bayer_bggr8", CV_8U, 1, cv::COLOR_BayerRG2GRAY},
    {"bayer_gbrg8", CV_8U, 1, cv::COLOR_BayerGR2GRAY},
    {"bayer_grbg8", CV_8U, 1, cv::COLOR_BayerGB2GRAY},
    {"mono16", CV_16U, 1, kIsGrey},
    {"16UC1", CV_16U, 1, kIsGrey},
    {"bgr16", CV_16U, 3, cv::COLOR_BGR2GRAY},
    {"16UC3", CV_16U, 3, cv::COLOR_BGR2GRAY},
    {"rgb16", CV_16U, 3, cv::COLOR_RGB2GRAY},
    {"bgra16", CV_16U, 4, cv::COLOR_BGRA2GRAY},
    {"16UC4", CV_16U, 4, cv::COLOR_BGRA2GRAY},
    {"rgba16", CV_16U, 4, cv::COLOR_RGBA2GRAY},
    {"bayer_rggb16", CV_16U, 1, cv::COLOR_BayerBG2GRAY},
    {"bayer_bggr16", CV_16U, 1, cv::COLOR_BayerRG2GRAY},
    {"bayer_gbrg16", CV_16U, 1, cv::COLOR_BayerGR2GRAY},
    {"bayer_grbg16", CV_16U, 1, cv::COLOR_BayerGB2GRAY},
    {"yuv422", CV_8U, 2, cv::COLOR_YUV2GRAY_UYVY},
    {"yuv422_yuy2", CV_8U, 2, cv::COLOR_YUV2GRAY_YUY2},
};

/// Of 16-bit numbers, into pixels of its own.
cv::Mat swapBytes(const cv::Mat& numbers) {
  cv::Mat swapped = numbers.clone();
  const int row_numbers = swapped.cols * swapped.channels();
  for (int row = 0; row < swapped.rows; ++row) {
    auto* const first = swapped.ptr<std::uint16_t>(row);
    std::transform(first, first + row_numbers, first,
                   [](std::uint16_t n) { return static_cast<std::uint16_t>(n << 8 | n >> 8); });
  }
  return swapped;
}

template <typename Range>
bool allZero(const Range& values) {
  return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

DistortionModel toDistortionModel(const std::string& name) {
  if (name == sensor_msgs::distortion_models::PLUMB_BOB) return DistortionModel::kPlumbBob;
  if (name == sensor_msgs::distortion_models::RATIONAL_POLYNOMIAL) {
    return DistortionModel::kRationalPolynomial;
  }
  if (name == sensor_msgs::distortion_models::EQUIDISTANT || name == "fisheye") {
    return DistortionModel::kEquidistant;
  }
  throw OptionError("the distortion model is \"" + name +
                    "\"; known are plumb_bob, rational_polynomial and equidistant");
}

/// The camera of the full resolution by K or P (3 x columns, row by row; the last column of P tells
/// where another camera of a pair is and is left out). Throws OptionError when it is no camera's.
PinholeCamera cameraOf(const sensor_msgs::CameraInfo& info, const double* matrix, int columns) {
  const auto at = [&](int row, int column) { return matrix[row * columns + column]; };
  PinholeCamera camera;
  camera.width = static_cast<int>(std::min(info.width, kMaxSide + 1));
  camera.height = static_cast<int>(std::min(info.height, kMaxSide + 1));
  camera.fx = at(0, 0);
  camera.fy = at(1, 1);
  camera.cx = at(0, 2);
  camera.cy = at(1, 2);
  camera.validate();
  const char* const name = columns == 4 ? "P" : "K";
  if (at(0, 1) != 0 || at(1, 0) != 0 || at(2, 0) != 0 || at(2, 1) != 0 || at(2, 2) != 1) {
    throw OptionError(std::string(name) + " is not of the form fx 0 cx, 0 fy cy, 0 0 1");
  }
  requireInRange("width * height [px]", 1.0 * camera.width * camera.height, 1, kMaxPixels);
  requireInRange("fx [image widths]", camera.fx / camera.width, 0.02, 500);
  requireInRange("fy / fx", camera.fy / camera.fx, 0.1, 10);
  requireInRange("cx [image widths]", camera.cx / camera.width, -10, 10);
  requireInRange("cy [image heights]", camera.cy / camera.height, -10, 10);
  return camera;
}

/// The camera of the images when they are a part of the full resolution (roi), or coarser
/// (binning), as image_geometry has it. Throws OptionError when the part is none.
PinholeCamera partOf(const sensor_msgs::CameraInfo& info, PinholeCamera camera) {
  sensor_msgs::RegionOfInterest roi = info.roi;
  if (roi.x_offset == 0 && roi.y_offset == 0 && roi.width == 0 && roi.height == 0) {
    roi.width = info.width;
    roi.height = info.height;
  }
  const std::uint32_t bin_x = std::max(info.binning_x, 1u);
  const std::uint32_t bin_y = std::max(info.binning_y, 1u);
  if (roi.width < bin_x || roi.x_offset > info.width || roi.width > info.width - roi.x_offset ||
      roi.height < bin_y || roi.y_offset > info.height || roi.height > info.height - roi.y_offset) {
    throw OptionError("the roi of " + std::to_string(roi.width) + " x " +
                      std::to_string(roi.height) + " at (" + std::to_string(roi.x_offset) + ", " +
                      std::to_string(roi.y_offset) + ") with a binning of " +
                      std::to_string(bin_x) + " x " + std::to_string(bin_y) +
                      " is no part of an image of " + std::to_string(info.width) + " x " +
                      std::to_string(info.height));
  }
  camera.width = static_cast<int>(roi.width / bin_x);
  camera.height = static_cast<int>(roi.height / bin_y);
  camera.fx /= bin_x;
  camera.fy /= bin_y;
  camera.cx = (camera.cx - roi.x_offset) / bin_x;
  camera.cy = (camera.cy - roi.y_offset) / bin_y;
  return camera;
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

/// Carries (linear, angular) small motions over to other axes (rotated by R) and to another point
/// of the same body, at `lever` from the old one in the old axes: v' = R (v + w x lever), w' = R w.
Matrix6d carry(const Eigen::Matrix3d& R, const Eigen::Vector3d& lever) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = R;
  J.topRightCorner<3, 3>() = -R * skew(lever);
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

cv::Mat GreyConverter::convert(const sensor_msgs::Image& image) {
  if (image.width == 0 || image.height == 0) throw MessageError("the image has no pixels");
  if (image.width > kMaxSide || image.height > kMaxSide) {
    throw MessageError("the image is " + std::to_string(image.width) + " x " +
                       std::to_string(image.height) + ", which is no camera's size");
  }
  const auto* const encoding =
      std::find_if(std::begin(kEncodings), std::end(kEncodings),
                   [&](const Encoding& known) { return known.name == image.encoding; });
  if (encoding == std::end(kEncodings)) {
    throw MessageError("the encoding \"" + image.encoding +
                       "\" cannot be turned into grey; mono, colour and Bayer of 8 or 16 bits and "
                       "yuv422 can");
  }
  const std::size_t number_bytes = encoding->depth == CV_16U ? 2 : 1;
  const std::size_t step = image.step;
  if (step < image.width * number_bytes * static_cast<std::size_t>(encoding->channels) ||
      step % number_bytes != 0) {
    throw MessageError("the step of " + std::to_string(step) + " bytes does not fit " +
                       std::to_string(image.width) + " pixels of " + image.encoding);
  }
  if (image.data.size() != step * image.height) {
    throw MessageError("the image holds " + std::to_string(image.data.size()) +
                       " bytes instead of " + std::to_string(step * image.height));
  }

  // cv::Mat has no const pixels; these are not written to.
  cv::Mat grey(static_cast<int>(image.height), static_cast<int>(image.width),
               CV_MAKETYPE(encoding->depth, encoding->channels),
               const_cast<std::uint8_t*>(image.data.data()), step);
  if (number_bytes == 2 && image.is_bigendian != 0) grey = swapBytes(grey);
  if (encoding->to_grey != kIsGrey) {
    cv::Mat converted;
    cv::cvtColor(grey, converted, encoding->to_grey);
    grey = converted;
  }
  return number_bytes == 2 ? toEightBits(grey) : grey;
}

cv::Mat GreyConverter::toEightBits(const cv::Mat& grey) {
  double brightest = 0;
  cv::minMaxLoc(grey, nullptr, &brightest);
  while (brightest >= std::ldexp(1.0, bits_)) bits_ += 2;
  cv::Mat eight_bits;
  grey.convertTo(eight_bits, CV_8U, 255 / (std::ldexp(1.0, bits_) - 1));
  return eight_bits;
}

bool operator==(const Calibration& a, const Calibration& b) {
  return a.raw.width == b.raw.width && a.raw.height == b.raw.height && a.raw.fx == b.raw.fx &&
         a.raw.fy == b.raw.fy && a.raw.cx == b.raw.cx && a.raw.cy == b.raw.cy &&
         a.model == b.model && a.coefficients == b.coefficients;
}

Calibration toCalibration(const sensor_msgs::CameraInfo& info, const std::string& topic,
                          bool image_is_rectified) {
  const std::string subject = "camera_info on topic " + topic;
  if (!areFinite(info.K, info.P, info.D, info.R)) {
    throw MessageError(subject + " has numbers that are not finite");
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
  try {
    if (image_is_rectified || !has_K) {
      calibration.raw = partOf(info, cameraOf(info, info.P.data(), 4));
    } else {
      calibration.raw = partOf(info, cameraOf(info, info.K.data(), 3));
      // Zero coefficients are no distortion, but for the fisheye, which bends without any.
      const bool unnamed = info.distortion_model.empty() && allZero(info.D);
      const DistortionModel model =
          unnamed ? DistortionModel::kNone : toDistortionModel(info.distortion_model);
      if (model == DistortionModel::kEquidistant || !allZero(info.D)) {
        calibration.model = model;
        calibration.coefficients = info.D;
      }
    }
  } catch (const OptionError& error) {
    throw MessageError(subject + " cannot be used: " + error.what());
  }
  return calibration;
}

Rectifier toRectifier(const Calibration& calibration, const std::string& topic) {
  try {
    return Rectifier(calibration.raw, calibration.model, calibration.coefficients);
  } catch (const std::exception& error) {
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
  const Vector6d twist_b = J * pose.twist_c;
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
