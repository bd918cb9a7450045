#include "ground_scale_vo/ros/image_receiver.hpp"

#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/image_message.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kCameraInfoQueue = 100;

}  // namespace

ImageReceiver::ImageReceiver(ros::NodeHandle handle, const ros::NodeHandle& private_handle,
                             const Options& options, Handlers handlers)
    : handlers_(std::move(handlers)),
      image_is_rectified_(options.image_is_rectified),
      rectifier_(options.image_is_rectified, options.mask_file, options.camera_file),
      transport_(handle) {
  if (options.camera_file.empty()) {
    camera_info_subscriber_ =
        handle.subscribe("camera_info", kCameraInfoQueue, &ImageReceiver::onCameraInfo, this);
  } else if (!rectifier_.calibrationWarning().empty()) {
    rectification_warning_ = rectifier_.calibrationWarning();
    handlers_.on_warning(rectification_warning_);
  }
  const std::string& transport = options.image_transport;
  const bool is_either = transport == "raw_or_compressed";
  const image_transport::TransportHints hints(is_either ? "raw" : transport,
                                              ros::TransportHints().tcpNoDelay(), private_handle,
                                              is_either ? "no_parameter" : "image_transport");
  if (is_either || transport == "compressed") {
    compressed_subscriber_ =
        handle.subscribe(handle.resolveName("image") + "/compressed", options.image_queue_size,
                         &ImageReceiver::onCompressedImage, this, hints.getRosHints());
    if (!is_either) return;
  }
  try {
    image_subscriber_ = transport_.subscribe("image", options.image_queue_size,
                                             &ImageReceiver::onImage, this, hints);
  } catch (const std::exception& error) {
    throw OptionError("parameter image_transport is \"" + options.image_transport +
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
    return handlers_.on_drop("camera_info refused", camera_info_error_);
  }
  checkRectification(*info);
  handlers_.on_camera();
}

void ImageReceiver::reportSourceError() {
  const std::string error = sourceError();
  if (std::exchange(has_source_error_, !error.empty()) || error.empty()) return;
  handlers_.on_error(error);
}

void ImageReceiver::onCompressedImage(const sensor_msgs::CompressedImageConstPtr& compressed) {
  countImage();
  sensor_msgs::ImageConstPtr image;
  try {
    image = decode(*compressed);
  } catch (const DataError& error) {
    return handlers_.on_drop("image refused", error.what());
  }
  handlers_.on_image(image);
}

void ImageReceiver::checkRectification(const sensor_msgs::CameraInfo& info) {
  std::string warning =
      rectificationContradiction(fromMsg(info), image_is_rectified_, imageTopic()).reason;
  if (!warning.empty()) {
    warning = image_is_rectified_ ? "image_is_rectified is true, but " + warning +
                                        ": if the images are raw, set it to false"
                                  : "image_is_rectified is false, but " + warning +
                                        ": if the images are rectified, set it to true";
  }
  if (warning.empty()) warning = rectifier_.calibrationWarning();
  if (!warning.empty() && warning != rectification_warning_) handlers_.on_warning(warning);
  rectification_warning_ = std::move(warning);
}

void ImageReceiver::onImage(const sensor_msgs::ImageConstPtr& image) {
  countImage();
  handlers_.on_image(image);
}

void ImageReceiver::countImage() {
  ++images_received_;
  since_image_.emplace();
}

cv::Mat ImageReceiver::rectify(const sensor_msgs::Image& image) {
  return convert(image, &ImageRectifier::rectify);
}

cv::Mat ImageReceiver::given(const sensor_msgs::Image& image) {
  return convert(image, &ImageRectifier::given);
}

cv::Mat ImageReceiver::convert(const sensor_msgs::Image& image, Conversion conversion) {
  using Verdict = SourceGuard<std::string>::Verdict;
  const std::string source = "frame_id \"" + image.header.frame_id + "\", " +
                             std::to_string(image.width) + " x " + std::to_string(image.height);
  const bool is_of_other_camera = sources_.check(source) == Verdict::kOther;
  reportSourceError();
  try {
    cv::Mat grey = (rectifier_.*conversion)(image);
    if (!is_of_other_camera) return grey;
    handlers_.on_drop("image of another camera", sourceError());
  } catch (const std::exception& error) {
    handlers_.on_drop("image refused", error.what());
  }
  return {};
}

std::string ImageReceiver::cameraSource() const {
  return camera_info_subscriber_ ? "camera_info on topic " + cameraInfoTopic()
                                 : rectifier_.source();
}

std::string ImageReceiver::sourceError() const {
  if (sources_.alternates()) {
    return "two cameras publish on " + imageTopic() + ": the images alternate between " +
           sources_.current() + ", which are used, and " + sources_.other().value_or("");
  }
  return rectifier_.calibrationError(cameraInfoTopic());
}

std::optional<double> ImageReceiver::secondsSinceImage() const {
  if (!since_image_) return std::nullopt;
  return since_image_->seconds();
}

}  // namespace ground_scale_vo
