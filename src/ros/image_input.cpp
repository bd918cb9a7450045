#include "ground_scale_vo/ros/image_input.hpp"

#include <algorithm>
#include <exception>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "input/camera_info.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kCameraInfoQueue = 100;

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
      mask_(readMask(mask_file)) {
  if (!camera_file.empty()) readCamera(camera_file);
}

void ImageRectifier::readCamera(const std::string& file) {
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

void ImageRectifier::setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic) {
  const CameraCalibration calibration = readCameraInfo(fromMsg(info), topic, image_is_rectified_);
  const std::string source = "camera_info on topic " + topic;
  const std::string warning = check(calibration, source);
  using Verdict = decltype(calibrations_)::Verdict;
  const Verdict verdict = calibrations_.check(calibration);
  if (verdict == Verdict::kRefused) throw DataError(calibrationError());
  if (verdict == Verdict::kChanged) use(calibration, source, warning);
}

/// Returns a warning, or an empty text. Throws DataError.
std::string ImageRectifier::check(const CameraCalibration& calibration,
                                  const std::string& source) const {
  try {
    requireMask(mask_, pinholeOf(calibration), mask_name_);
  } catch (const OptionError& error) {
    throw DataError(std::string(error.what()) + " of " + source);
  }
  return checkCalibration(calibration, source, sizeOf(calibration));
}

void ImageRectifier::use(const CameraCalibration& calibration, const std::string& source,
                         const std::string& warning) {
  undistortion_.emplace(calibration, mask_);
  camera_ = std::make_shared<const CameraCalibration>(calibration);
  source_ = source;
  calibration_warning_ = warning;
  refined_.reset();
}

std::string ImageRectifier::calibrationError() const {
  if (!calibrations_.refused()) return {};
  return source_ + " keeps changing, as of two cameras: " + camera_->describe() +
         " is used until it settles, the last one is " + calibrations_.refused()->describe() +
         "; publish one constant calibration";
}

CameraImage ImageRectifier::rectify(const sensor_msgs::Image& image) {
  return undistortion_->image(toGrey(image));
}

CameraImage ImageRectifier::refined(const sensor_msgs::Image& image,
                                    const CameraCalibration& lens) {
  if (!refined_ || !(lens_ == lens)) {
    lens_ = lens;
    if (camera_->hasLens()) {
      refined_.emplace(lens, mask_);
    } else {
      refined_.emplace(*camera_, mask_, lens);
    }
  }
  return refined_->image(toGrey(image));
}

cv::Mat ImageRectifier::toGrey(const sensor_msgs::Image& image) {
  const cv::Size size(static_cast<int>(std::min(image.width, kMaxImageSide)),
                      static_cast<int>(std::min(image.height, kMaxImageSide)));
  if (size != sizeOf(*camera_)) checkCalibration(*camera_, source_, size);  // throws
  return grey_converter_.convert(fromMsg(image));
}

ImageReceiver::ImageReceiver(ros::NodeHandle handle, const ros::NodeHandle& private_handle,
                             const ImageParams& params, std::uint32_t queue_size, WarningLog* log,
                             OnImage on_image, OnCamera on_camera)
    : image_is_rectified_(params.image_is_rectified),
      log_(log),
      on_image_(std::move(on_image)),
      on_camera_(std::move(on_camera)),
      rectifier_(params.image_is_rectified, params.mask, params.camera_file),
      transport_(handle) {
  if (params.camera_file.empty()) {
    camera_info_subscriber_ =
        handle.subscribe("camera_info", kCameraInfoQueue, &ImageReceiver::onCameraInfo, this);
  } else {
    warnOfCalibration(rectifier_.calibrationWarning());
  }
  const std::string& transport = params.image_transport;
  const bool is_either = transport == "raw_or_compressed";
  const image_transport::TransportHints hints(is_either ? "raw" : transport,
                                              ros::TransportHints().tcpNoDelay(), private_handle,
                                              is_either ? "no_parameter" : "image_transport");
  if (is_either || transport == "compressed") {
    compressed_subscriber_ =
        handle.subscribe(handle.resolveName("image") + "/compressed", queue_size,
                         &ImageReceiver::onCompressedImage, this, hints.getRosHints());
    if (!is_either) return;
  }
  try {
    image_subscriber_ =
        transport_.subscribe("image", queue_size, &ImageReceiver::onImage, this, hints);
  } catch (const std::exception& error) {
    throw OptionError("parameter image_transport is \"" + transport +
                      "\", which cannot be used: " + error.what());
  }
}

void ImageReceiver::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  try {
    rectifier_.setCameraInfo(*info, cameraInfoTopic());
    camera_info_error_.clear();
    reportSourceError();
  } catch (const DataError& error) {
    camera_info_error_ = error.what();
    reportSourceError();
    log_->drop("camera_info refused", camera_info_error_);
    return;
  }
  const std::string warning = rectificationWarning(*info);
  warnOfCalibration(warning.empty() ? rectifier_.calibrationWarning() : warning);
  on_camera_();
}

void ImageReceiver::reportSourceError() {
  const std::string error = sourceError();
  if (!std::exchange(has_source_error_, !error.empty()) && !error.empty()) {
    log_->error("source", error);
  }
}

std::string ImageReceiver::rectificationWarning(const sensor_msgs::CameraInfo& info) const {
  const std::string reason =
      rectificationContradiction(fromMsg(info), image_is_rectified_, imageTopic()).reason;
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

cv::Mat ImageReceiver::toGrey(const sensor_msgs::Image& image) {
  return checked(image, [&] { return CameraImage{rectifier_.toGrey(image), {}, {}}; }).grey;
}

CameraImage ImageReceiver::imageOf(const VoFrame& frame, const sensor_msgs::Image& image) {
  if (!camera()) return {};
  if (!frame.distortion.empty()) {  // the odometry refines the lens
    CameraCalibration calibration = calibrationOf(Lens{frame.camera});
    std::copy(frame.distortion.begin(), frame.distortion.end(), calibration.distortion.begin());
    return checked(image, [&] { return rectifier_.refined(image, calibration); });
  }
  if (isSameCalibration(withoutDistortion(pinholeOf(*camera())), withoutDistortion(frame.camera))) {
    return checked(image, [&] { return rectifier_.rectify(image); });
  }
  const std::string source_error = sourceError();
  log_->drop("other camera", source_error.empty()
                                 ? rectifier_.source() + " describes another camera than vo/frame"
                                 : source_error);
  return {};
}

/// The conversion of an image, unless it is of another camera.
CameraImage ImageReceiver::checked(const sensor_msgs::Image& image, const Conversion& conversion) {
  CameraImage converted;
  try {
    converted = conversion();
  } catch (const std::exception& error) {
    log_->drop("image refused", error.what());
    return {};
  }
  const bool is_of_other_camera =
      sources_.check(image.header.frame_id) == decltype(sources_)::Verdict::kRefused;
  reportSourceError();
  if (!is_of_other_camera) return converted;
  log_->drop("image of another camera", sourceError());
  return {};
}

std::string ImageReceiver::imageTopic() const {
  return !image_subscriber_ || compressed_subscriber_.getNumPublishers() > 0
             ? compressed_subscriber_.getTopic()
             : image_subscriber_.getTopic();
}

std::optional<MissingInput> ImageReceiver::missingCameraInfo() const {
  if (camera() || !camera_info_error_.empty()) return std::nullopt;
  return MissingInput{"camera_info", "no camera_info received yet on " + cameraInfoTopic()};
}

std::string ImageReceiver::sourceError() const {
  if (!sources_.refused()) return rectifier_.calibrationError();
  return "two cameras publish on " + imageTopic() + ": images with the frame_id \"" +
         sources_.current() + "\" are used, those with \"" + *sources_.refused() + "\" are not";
}

}  // namespace ground_scale_vo
