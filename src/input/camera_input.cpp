#include "input/camera_input.hpp"

#include "ground_scale_vo/common/error.hpp"

namespace gsv {

void CameraInput::setCalibration(const CameraCalibration& given, const std::string& source) {
  source_ = source;
  CameraCalibration calibration = given;
  if (!given.hasSize()) {
    if (!camera_) {
      unsized_ = given;
      return;
    }
    calibration.width = camera_->width;
    calibration.height = camera_->height;
  }
  try {
    requireMask(mask_, pinholeOf(calibration), mask_name_);
  } catch (const OptionError& error) {
    throw DataError(std::string(error.what()) + " of " + source_);
  }
  const std::string warning =
      checkCalibration(calibration, source_, {calibration.width, calibration.height});
  if (!calibrations_.accepts(calibration)) throw DataError(calibrationError());
  warning_ = warning;
  unsized_.reset();
  if (camera_ && isSameCalibration(*camera_, *calibrations_.current())) return;
  camera_ = std::make_shared<const CameraCalibration>(calibration);
}

void CameraInput::setCameraInfo(const CameraInfo& info, const std::string& topic,
                                const std::string& image_topic) {
  setCalibration(readCameraInfo(info, topic, image_is_rectified_), "camera_info on topic " + topic);
  const std::string reason =
      rectificationContradiction(info, image_is_rectified_, image_topic).reason;
  if (reason.empty()) return;
  warning_ = image_is_rectified_
                 ? "image_is_rectified is true, but " + reason +
                       ": if the images are raw, set it to false (no --rectified)"
                 : "image_is_rectified is false, but " + reason +
                       ": if the images are rectified, set it to true (--rectified)";
}

std::string CameraInput::calibrationError() const {
  if (!calibrations_.refused()) return {};
  return source_ + " keeps changing, as of two cameras: " + camera_->describe() +
         " is used until it settles, the last one is " + calibrations_.refused()->describe() +
         "; publish one constant calibration";
}

std::string CameraInput::sourceError(const std::string& image_topic) const {
  if (!frame_ids_.refused()) return calibrationError();
  return "two cameras publish on " + image_topic + ": images with the frame_id \"" +
         *frame_ids_.current() + "\" are used, those with \"" + *frame_ids_.refused() +
         "\" are not";
}

cv::Mat CameraInput::grey(const cv::Mat& pixels, const std::string& encoding) {
  if (unsized_) {
    checkCalibration(*unsized_, source_, pixels.size());
    CameraCalibration sized = *unsized_;
    sized.width = pixels.cols;
    sized.height = pixels.rows;
    setCalibration(sized, source_);
  }
  const cv::Size size(camera_->width, camera_->height);
  if (pixels.size() != size) checkCalibration(*camera_, source_, pixels.size());  // throws
  return grey_converter_.convert(pixels, encoding);
}

bool CameraInput::isOfCamera(const std::string& frame_id) {
  const std::optional<std::string> before = frame_ids_.current();
  if (!frame_ids_.accepts(frame_id)) return false;
  if (before && *before != frame_id) camera_ = std::make_shared<const CameraCalibration>(*camera_);
  return true;
}

}  // namespace gsv
