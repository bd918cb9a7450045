#include "ground_scale_vo/ros/calibrated_camera.hpp"

#include <sensor_msgs/distortion_models.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/image_limits.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "ground_scale_vo/ros/message_error.hpp"
#include "ros/camera_info_values.hpp"

namespace ground_scale_vo {
namespace {

namespace models = sensor_msgs::distortion_models;

/// Points per side of the grid on which two rectifications are compared.
constexpr int kComparedPoints = 5;

/// image_geometry takes coefficients that are all zero for "no distortion" and would return the raw
/// image. An equidistant (fisheye) image is distorted even then; this coefficient, which moves no
/// pixel, makes it apply the model.
constexpr double kNegligibleCoefficient = 1e-12;

/// Intrinsics at full resolution from K or P, which has 3 or 4 columns; the last column of P, the
/// offset of a stereo camera, is not used. Throws OptionError for implausible numbers.
PinholeCamera fullResolutionCamera(const sensor_msgs::CameraInfo& info, const double* matrix,
                                   int columns) {
  const auto at = [&](int row, int column) { return matrix[row * columns + column]; };
  PinholeCamera camera;
  // The cast must not overflow; validate() refuses kMaxImageSide + 1.
  camera.width = static_cast<int>(std::min(info.width, kMaxImageSide + 1));
  camera.height = static_cast<int>(std::min(info.height, kMaxImageSide + 1));
  camera.fx = at(0, 0);
  camera.fy = at(1, 1);
  camera.cx = at(0, 2);
  camera.cy = at(1, 2);
  camera.validate();
  const char* const name = columns == 4 ? "P" : "K";
  if (at(0, 1) != 0 || at(1, 0) != 0 || at(2, 0) != 0 || at(2, 1) != 0 || at(2, 2) != 1) {
    throw OptionError(std::string(name) + " is not of the form fx 0 cx, 0 fy cy, 0 0 1");
  }
  requireInRange("width * height [px]", 1.0 * camera.width * camera.height, 1, kMaxImagePixels);
  requireInRange("fx [image widths]", camera.fx / camera.width, 0.02, 500);
  requireInRange("fy / fx", camera.fy / camera.fx, 0.1, 10);
  requireInRange("cx [image widths]", camera.cx / camera.width, -10, 10);
  requireInRange("cy [image heights]", camera.cy / camera.height, -10, 10);
  return camera;
}

std::string sizeText(std::uint32_t width, std::uint32_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

/// Throws OptionError unless the ROI is a part of the image and at least one pixel of it is left
/// after binning. image_geometry checks neither.
void requireValidRoi(const sensor_msgs::CameraInfo& info) {
  sensor_msgs::RegionOfInterest roi = info.roi;
  std::string subject = "the ROI of " + sizeText(roi.width, roi.height) + " at (" +
                        std::to_string(roi.x_offset) + ", " + std::to_string(roi.y_offset) + ")";
  const std::string image = "the image of " + sizeText(info.width, info.height);
  if (roi.x_offset == 0 && roi.y_offset == 0 && roi.width == 0 && roi.height == 0) {
    roi.width = info.width;
    roi.height = info.height;
    subject = image;
  }
  if (roi.x_offset > info.width || roi.width > info.width - roi.x_offset ||
      roi.y_offset > info.height || roi.height > info.height - roi.y_offset) {
    throw OptionError(subject + " is not inside " + image);
  }
  const std::uint32_t bin_x = std::max(info.binning_x, 1u);
  const std::uint32_t bin_y = std::max(info.binning_y, 1u);
  if (roi.width < bin_x || roi.height < bin_y) {
    throw OptionError("a binning of " + sizeText(bin_x, bin_y) + " leaves no pixel of " + subject);
  }
}

/// The name by which image_geometry knows the model. Throws OptionError.
std::string distortionModel(const std::string& name) {
  if (name == models::PLUMB_BOB || name == models::RATIONAL_POLYNOMIAL) return name;
  if (isFisheye(name)) return models::EQUIDISTANT;
  throw OptionError("the distortion model is \"" + name +
                    "\"; supported are plumb_bob, rational_polynomial and equidistant");
}

/// Throws OptionError unless OpenCV accepts this number of coefficients and each is plausible.
void requireCoefficients(const std::string& model, const std::vector<double>& coefficients) {
  const std::size_t n = coefficients.size();
  if (model == models::EQUIDISTANT) {
    if (n != 4) {
      throw OptionError("equidistant distortion has 4 coefficients, not " + std::to_string(n));
    }
  } else if (n != 4 && n != 5 && n != 8 && n != 12 && n != 14) {
    throw OptionError(
        "plumb_bob or rational_polynomial distortion has 4, 5, 8, 12 or 14 coefficients, not " +
        std::to_string(n));
  }
  for (const double k : coefficients) requireInRange("distortion coefficient", k, -1e3, 1e3);
}

/// The same camera with R = I and P = [K | 0], so that rectified images keep K. use_P: the images
/// are rectified and P describes them. Throws OptionError.
sensor_msgs::CameraInfo monocularInfo(const sensor_msgs::CameraInfo& info, bool use_P) {
  const PinholeCamera camera = use_P ? fullResolutionCamera(info, info.P.data(), 4)
                                     : fullResolutionCamera(info, info.K.data(), 3);
  requireValidRoi(info);
  sensor_msgs::CameraInfo result = toCameraInfo(camera);
  result.binning_x = info.binning_x;
  result.binning_y = info.binning_y;
  result.roi = info.roi;
  result.roi.do_rectify = false;
  const bool is_unnamed = info.distortion_model.empty() && allZero(info.D);
  if (use_P || is_unnamed) return result;
  result.distortion_model = distortionModel(info.distortion_model);
  const bool is_fisheye = result.distortion_model == models::EQUIDISTANT;
  if (allZero(info.D) && !is_fisheye) return result;
  requireCoefficients(result.distortion_model, info.D);
  result.D = info.D;
  if (allZero(info.D)) result.D[0] = kNegligibleCoefficient;
  return result;
}

}  // namespace

CalibratedCamera::CalibratedCamera(const sensor_msgs::CameraInfo& info, const std::string& topic,
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
    throw MessageError(subject + " has no P, which image_is_rectified requires");
  }
  try {
    set(monocularInfo(info, image_is_rectified || !has_K));
  } catch (const OptionError& error) {
    throw MessageError(subject + " cannot be used: " + error.what());
  }
}

CalibratedCamera::CalibratedCamera(const CameraCalibration& calibration) {
  const CameraCalibration& c = calibration;
  sensor_msgs::CameraInfo info = toCameraInfo({c.width, c.height, c.fx, c.fy, c.cx, c.cy});
  info.D.assign(c.distortion.begin(), c.distortion.end());
  set(monocularInfo(info, false));
  camera_.lens_is_estimated = given_.estimated = c.estimated;
}

void CalibratedCamera::set(const sensor_msgs::CameraInfo& info) {
  is_distorted_ = !allZero(info.D);
  model_.fromCameraInfo(info);
  const cv::Size size = model_.reducedResolution();
  camera_ = {size.width, size.height, model_.fx(), model_.fy(), model_.cx(), model_.cy()};
  camera_.validate();
  given_ = calibrationOf(Lens{camera_});
  is_given_rectified_ =
      is_distorted_ && (info.distortion_model != models::PLUMB_BOB || info.D.size() > 5);
  if (!is_given_rectified_) std::copy(info.D.begin(), info.D.end(), given_.distortion.begin());
}

cv::Mat CalibratedCamera::rectify(const cv::Mat& raw) const {
  requireImage(raw, camera_);
  if (!is_distorted_) return raw;
  cv::Mat rectified;
  model_.rectifyImage(raw, rectified);
  return rectified;
}

cv::Mat CalibratedCamera::rectifyMask(const cv::Mat& mask) const {
  requireMask(mask, camera_);
  if (!is_distorted_ || mask.empty()) return mask;
  return rectify(mask != 0) == 255;
}

bool CalibratedCamera::isSameAs(const CalibratedCamera& other) const {
  if (!matches(other.camera_)) return false;
  if (!is_distorted_ && !other.is_distorted_) return true;
  const double last = kComparedPoints - 1;
  for (int i = 0; i < kComparedPoints * kComparedPoints; ++i) {
    const cv::Point2d rectified((camera_.width - 1) * (i % kComparedPoints / last),
                                (camera_.height - 1) * (i / kComparedPoints / last));
    const cv::Point2d offset =
        model_.unrectifyPoint(rectified) - other.model_.unrectifyPoint(rectified);
    if (!(std::hypot(offset.x, offset.y) <= kTolerancePx)) return false;
  }
  return true;
}

bool CalibratedCamera::matches(const PinholeCamera& other) const {
  const auto same = [](double a, double b) { return std::abs(a - b) <= kTolerancePx; };
  return camera_.width == other.width && camera_.height == other.height &&
         same(camera_.fx, other.fx) && same(camera_.fy, other.fy) && same(camera_.cx, other.cx) &&
         same(camera_.cy, other.cy);
}

std::string CalibratedCamera::describe() const {
  std::ostringstream text;
  text.precision(10);
  text << camera_.width << " x " << camera_.height << ", fx " << camera_.fx << ", fy " << camera_.fy
       << ", cx " << camera_.cx << ", cy " << camera_.cy << ", ";
  if (!is_distorted_) {
    text << "no distortion";
    return text.str();
  }
  const sensor_msgs::CameraInfo& info = model_.cameraInfo();
  text << info.distortion_model << ", D (";
  for (std::size_t i = 0; i < info.D.size(); ++i) text << (i > 0 ? ", " : "") << info.D[i];
  text << ")";
  return text.str();
}

sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera) {
  sensor_msgs::CameraInfo info;
  info.width = static_cast<std::uint32_t>(camera.width);
  info.height = static_cast<std::uint32_t>(camera.height);
  info.distortion_model = models::PLUMB_BOB;
  info.D.assign(5, 0.0);
  info.K = {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0};
  return info;
}

}  // namespace ground_scale_vo
