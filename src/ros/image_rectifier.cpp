#include "ground_scale_vo/ros/image_rectifier.hpp"

#include <algorithm>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/camera_calibration.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image_file.hpp"
#include "ground_scale_vo/ros/image_message.hpp"

namespace ground_scale_vo {
namespace {

cv::Mat readMask(const std::string& file) {
  if (file.empty()) return {};
  try {
    return readGreyImage(file);
  } catch (const DataError& error) {
    throw OptionError(std::string("parameter mask: ") + error.what());
  }
}

cv::Size sizeOf(const CameraCalibration& calibration) {
  return {calibration.width, calibration.height};
}

}  // namespace

ImageRectifier::ImageRectifier(bool image_is_rectified, const std::string& mask_file,
                               const std::string& camera_file)
    : image_is_rectified_(image_is_rectified),
      mask_name_("parameter mask: " + mask_file),
      raw_mask_(readMask(mask_file)) {
  if (!camera_file.empty()) readCamera(camera_file);
}

void ImageRectifier::readCamera(const std::string& file) {
  source_ = "parameter camera_file: " + file;
  std::shared_ptr<const CalibratedCamera> camera;
  try {
    const CameraCalibration calibration = readCameraFile(file);
    if (!calibration.hasSize()) {
      throw DataError(file + ": contains no image size, which a live camera needs");
    }
    readout_time_ = calibration.readout_time;
    calibration_warning_ = checkCalibration(calibration, source_, sizeOf(calibration));
    camera = std::make_shared<const CalibratedCamera>(calibration);
  } catch (const DataError& error) {  // it begins with the name of the file
    throw OptionError(std::string("parameter camera_file: ") + error.what());
  }
  try {
    requireMask(raw_mask_, camera->camera(), mask_name_);
  } catch (const OptionError& error) {
    throw OptionError(std::string(error.what()) + " of " + source_);
  }
  use(std::move(camera));
}

void ImageRectifier::use(std::shared_ptr<const CalibratedCamera> camera) {
  camera_ = std::move(camera);
  mask_ = camera_->undistortion().mask(raw_mask_);
  given_mask_ = camera_->isGivenRectified() ? mask_ : raw_mask_;
}

void ImageRectifier::setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  const CameraCalibration calibration = calibrationOf(fromMsg(info), topic, image_is_rectified_);
  const std::string source = "camera_info on topic " + topic;
  const std::string warning = checkCalibration(calibration, source, sizeOf(calibration));
  try {
    requireMask(raw_mask_, pinholeOf(calibration), mask_name_);
  } catch (const OptionError& error) {
    throw DataError(std::string(error.what()) + " of " + source);
  }
  switch (calibrations_.check(calibration)) {
    case decltype(calibrations_)::Verdict::kSame:
      return;
    case decltype(calibrations_)::Verdict::kChanged:
      calibration_warning_ = warning;
      return use(std::make_shared<const CalibratedCamera>(calibration));
    default:
      throw DataError(calibrationError(topic));
  }
}

std::string ImageRectifier::calibrationError(const std::string& topic) const {
  if (!calibrations_.keepsChanging()) return {};
  const std::string used = camera_->calibration().describe(),
                    other = calibrations_.other()->describe();
  return calibrations_.alternates()
             ? "two cameras publish on " + topic + ": camera_info alternates between " + used +
                   ", which is used, and " + other
             : "camera_info on topic " + topic + " keeps changing: " + used +
                   " is used until it settles, the last one is " + other +
                   "; publish one constant calibration";
}

cv::Mat ImageRectifier::rectify(const sensor_msgs::Image& image) {
  return camera_->undistortion().image(toGrey(image));
}

cv::Mat ImageRectifier::given(const sensor_msgs::Image& image) {
  return camera_->given(toGrey(image));
}

/// Before rectification. Throws DataError.
cv::Mat ImageRectifier::toGrey(const sensor_msgs::Image& image) {
  const CameraCalibration& calibration = camera_->calibration();
  const cv::Size size(static_cast<int>(std::min(image.width, kMaxImageSide)),
                      static_cast<int>(std::min(image.height, kMaxImageSide)));
  if (size != sizeOf(calibration)) checkCalibration(calibration, source_, size);  // throws
  return grey_converter_.convert(fromMsg(image));
}

}  // namespace ground_scale_vo
