#include "ros/image_input.hpp"

#include <algorithm>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "input/camera_info.hpp"

namespace gsv {
namespace {

cv::Mat readMask(const std::string& file) {
  if (file.empty()) return {};
  try {
    return readGreyImage(file);
  } catch (const DataError& error) {
    throw OptionError(std::string("parameter mask: ") + error.what());
  }
}

CameraInfo fieldsOf(const sensor_msgs::CameraInfo& msg) {
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

cv::Size sizeOf(const CameraCalibration& calibration) {
  return {calibration.width, calibration.height};
}

}  // namespace

CameraInput::CameraInput(bool image_is_rectified, const std::string& mask_file,
                         const std::string& camera_file)
    : image_is_rectified_(image_is_rectified),
      mask_name_("parameter mask: " + mask_file),
      mask_(readMask(mask_file)) {
  if (camera_file.empty()) return;
  source_ = "parameter camera_file: " + camera_file;
  try {
    const CameraCalibration calibration = readCameraFile(camera_file);
    if (!calibration.hasSize()) {
      throw DataError(camera_file + ": contains no image size, which a live camera needs");
    }
    warning_ = check(calibration);
    camera_ = std::make_shared<const CameraCalibration>(calibration);
  } catch (const DataError& error) {  // it begins with the name of the file
    throw OptionError(std::string("parameter camera_file: ") + error.what());
  }
}

void CameraInput::setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic,
                                const std::string& image_topic) {
  const CameraInfo fields = fieldsOf(info);
  const CameraCalibration calibration = readCameraInfo(fields, topic, image_is_rectified_);
  source_ = "camera_info on topic " + topic;
  const std::string warning = check(calibration);
  if (!calibrations_.accepts(calibration)) throw DataError(calibrationError());
  warning_ = warning;
  const std::string reason =
      rectificationContradiction(fields, image_is_rectified_, image_topic).reason;
  if (!reason.empty()) {
    warning_ = image_is_rectified_ ? "image_is_rectified is true, but " + reason +
                                         ": if the images are raw, set it to false"
                                   : "image_is_rectified is false, but " + reason +
                                         ": if the images are rectified, set it to true";
  }
  if (camera_ && isSameCalibration(*camera_, calibrations_.current())) return;
  camera_ = std::make_shared<const CameraCalibration>(calibration);
}

/// Returns a warning, or an empty text. Throws DataError.
std::string CameraInput::check(const CameraCalibration& calibration) const {
  try {
    requireMask(mask_, pinholeOf(calibration), mask_name_);
  } catch (const OptionError& error) {
    throw DataError(std::string(error.what()) + " of " + source_);
  }
  return checkCalibration(calibration, source_, sizeOf(calibration));
}

std::string CameraInput::calibrationError() const {
  if (!calibrations_.refused()) return {};
  return source_ + " keeps changing, as of two cameras: " + camera_->describe() +
         " is used until it settles, the last one is " + calibrations_.refused()->describe() +
         "; publish one constant calibration";
}

cv::Mat CameraInput::grey(const cv::Mat& pixels, const std::string& encoding) {
  if (pixels.size() != sizeOf(*camera_))
    checkCalibration(*camera_, source_, pixels.size());  // throws
  return grey_converter_.convert(pixels, encoding);
}

}  // namespace gsv
