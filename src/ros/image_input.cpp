#include "ros/image_input.hpp"

#include <algorithm>
#include <exception>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "input/camera_info.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kQueue = 100;  // [messages] that wait for their callback

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
  if (!camera_file.empty()) readCamera(camera_file);
}

void CameraInput::readCamera(const std::string& file) {
  const std::string source = "parameter camera_file: " + file;
  try {
    const CameraCalibration calibration = readCameraFile(file);
    if (!calibration.hasSize()) {
      throw DataError(file + ": contains no image size, which a live camera needs");
    }
    use(calibration, source, check(calibration, source));
  } catch (const DataError& error) {  // it begins with the name of the file
    throw OptionError(std::string("parameter camera_file: ") + error.what());
  }
}

void CameraInput::setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  const CameraCalibration calibration = readCameraInfo(fieldsOf(info), topic, image_is_rectified_);
  const std::string source = "camera_info on topic " + topic;
  const std::string warning = check(calibration, source);
  if (!calibrations_.accepts(calibration)) throw DataError(calibrationError());
  if (!camera_ || !isSameCalibration(*camera_, calibrations_.current())) {
    use(calibration, source, warning);
  }
}

/// Returns a warning, or an empty text. Throws DataError.
std::string CameraInput::check(const CameraCalibration& calibration,
                               const std::string& source) const {
  try {
    requireMask(mask_, pinholeOf(calibration), mask_name_);
  } catch (const OptionError& error) {
    throw DataError(std::string(error.what()) + " of " + source);
  }
  return checkCalibration(calibration, source, sizeOf(calibration));
}

void CameraInput::use(const CameraCalibration& calibration, const std::string& source,
                      const std::string& warning) {
  camera_ = std::make_shared<const CameraCalibration>(calibration);
  source_ = source;
  calibration_warning_ = warning;
}

std::string CameraInput::calibrationError() const {
  if (!calibrations_.refused()) return {};
  return source_ + " keeps changing, as of two cameras: " + camera_->describe() +
         " is used until it settles, the last one is " + calibrations_.refused()->describe() +
         "; publish one constant calibration";
}

cv::Mat CameraInput::grey(const sensor_msgs::Image& image) {
  const cv::Size size(static_cast<int>(std::min(image.width, kMaxImageSide)),
                      static_cast<int>(std::min(image.height, kMaxImageSide)));
  if (size != sizeOf(*camera_)) checkCalibration(*camera_, source_, size);  // throws
  return grey_converter_.convert(fromMsg(image));
}

ImageReceiver::ImageReceiver(ros::NodeHandle handle, const ros::NodeHandle& private_handle,
                             const MonoVoParams& params, WarningLog* log, OnImage on_image,
                             OnCamera on_camera)
    : image_is_rectified_(params.image_is_rectified),
      log_(log),
      on_image_(std::move(on_image)),
      on_camera_(std::move(on_camera)),
      input_(params.image_is_rectified, params.mask, params.camera_file),
      transport_(handle) {
  if (params.camera_file.empty()) {
    camera_info_subscriber_ =
        handle.subscribe("camera_info", kQueue, &ImageReceiver::onCameraInfo, this);
  } else {
    warnOfCalibration(input_.calibrationWarning());
  }
  const std::string& transport = params.image_transport;
  const bool is_either = transport == "raw_or_compressed";
  const image_transport::TransportHints hints(is_either ? "raw" : transport,
                                              ros::TransportHints().tcpNoDelay(), private_handle,
                                              is_either ? "no_parameter" : "image_transport");
  if (is_either || transport == "compressed") {
    compressed_subscriber_ =
        handle.subscribe(handle.resolveName("image") + "/compressed", kQueue,
                         &ImageReceiver::onCompressedImage, this, hints.getRosHints());
    if (!is_either) return;
  }
  try {
    image_subscriber_ = transport_.subscribe("image", kQueue, &ImageReceiver::onImage, this, hints);
  } catch (const std::exception& error) {
    throw OptionError("parameter image_transport is \"" + transport +
                      "\", which cannot be used: " + error.what());
  }
}

void ImageReceiver::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  try {
    input_.setCameraInfo(*info, cameraInfoTopic());
  } catch (const DataError& error) {
    camera_info_error_ = error.what();
    log_->drop("camera_info refused", camera_info_error_, camera_info_error_ == sourceError());
    return;
  }
  camera_info_error_.clear();
  const std::string warning = rectificationWarning(*info);
  warnOfCalibration(warning.empty() ? input_.calibrationWarning() : warning);
  on_camera_();
}

std::string ImageReceiver::rectificationWarning(const sensor_msgs::CameraInfo& info) const {
  const std::string reason =
      rectificationContradiction(fieldsOf(info), image_is_rectified_, imageTopic()).reason;
  if (reason.empty()) return {};
  return image_is_rectified_ ? "image_is_rectified is true, but " + reason +
                                   ": if the images are raw, set it to false"
                             : "image_is_rectified is false, but " + reason +
                                   ": if the images are rectified, set it to true";
}

void ImageReceiver::warnOfCalibration(const std::string& warning) {
  if (std::exchange(calibration_warning_, warning) != warning && !warning.empty()) {
    log_->warn("calibration", warning, {});
  }
}

void ImageReceiver::onCompressedImage(const sensor_msgs::CompressedImageConstPtr& compressed) {
  images_.count();
  sensor_msgs::ImageConstPtr image;
  try {
    image = decode(*compressed);
  } catch (const DataError& error) {
    log_->drop("image refused", error.what());
    return;
  }
  on_image_(image);
}

void ImageReceiver::onImage(const sensor_msgs::ImageConstPtr& image) {
  images_.count();
  on_image_(image);
}

cv::Mat ImageReceiver::grey(const sensor_msgs::Image& image) {
  cv::Mat grey;
  try {
    grey = input_.grey(image);
  } catch (const std::exception& error) {
    log_->drop("image refused", error.what());
    return {};
  }
  if (sources_.accepts(image.header.frame_id)) return grey;
  log_->drop("image of another camera", sourceError(), true);
  return {};
}

std::string ImageReceiver::imageTopic() const {
  return !image_subscriber_ || compressed_subscriber_.getNumPublishers() > 0
             ? compressed_subscriber_.getTopic()
             : image_subscriber_.getTopic();
}

/// One sentence while two cameras publish on one topic or camera_info keeps changing, else empty.
std::string ImageReceiver::sourceError() const {
  if (!sources_.refused()) return input_.calibrationError();
  return "two cameras publish on " + imageTopic() + ": images with the frame_id \"" +
         sources_.current() + "\" are used, those with \"" + *sources_.refused() + "\" are not";
}

void ImageReceiver::describe(StageState* state) const {
  if (!camera() && !camera_info_error_.empty()) {
    state->errors = {camera_info_error_};
    return;
  }
  state->missing = images_.missing(imageTopic());
  if (state->missing.empty() && !camera()) {
    state->missing = "no camera_info received yet on " + cameraInfoTopic();
  }
  state->errors = {sourceError()};
  state->warnings = {camera_info_error_, calibration_warning_};
}

}  // namespace ground_scale_vo
