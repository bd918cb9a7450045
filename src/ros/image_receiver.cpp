#include "ground_scale_vo/ros/image_receiver.hpp"

#include <utility>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kCameraInfoQueue = 100;

}  // namespace

ImageReceiver::ImageReceiver(ros::NodeHandle handle, const ros::NodeHandle& private_handle,
                             const Options& options, Handlers handlers)
    : handlers_(std::move(handlers)),
      rectifier_(options.image_is_rectified),
      transport_(handle),
      camera_info_subscriber_(
          handle.subscribe("camera_info", kCameraInfoQueue, &ImageReceiver::onCameraInfo, this)) {
  const image_transport::TransportHints hints("raw", ros::TransportHints().tcpNoDelay(),
                                              private_handle);
  try {
    image_subscriber_ = transport_.subscribe("image", options.image_queue_size,
                                             &ImageReceiver::onImage, this, hints);
  } catch (const std::exception& error) {
    throw OptionError("parameter image_transport is \"" + hints.getTransport() +
                      "\", which cannot be used: " + error.what());
  }
}

void ImageReceiver::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  try {
    rectifier_.setCameraInfo(*info, cameraInfoTopic());
    camera_info_error_.clear();
  } catch (const MessageError& error) {
    camera_info_error_ = error.what();
    return handlers_.on_drop("camera_info refused", camera_info_error_);
  }
  handlers_.on_camera();
}

void ImageReceiver::onImage(const sensor_msgs::ImageConstPtr& image) {
  ++images_received_;
  since_image_.emplace();
  handlers_.on_image(image);
}

cv::Mat ImageReceiver::rectify(const sensor_msgs::Image& image) {
  try {
    return rectifier_.rectify(image);
  } catch (const std::exception& error) {
    handlers_.on_drop("image refused", error.what());
    return {};
  }
}

std::optional<double> ImageReceiver::secondsSinceImage() const {
  if (!since_image_) return std::nullopt;
  return since_image_->seconds();
}

}  // namespace ground_scale_vo
