#pragma once

#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/ros/image_rectifier.hpp"
#include "ground_scale_vo/ros/source_guard.hpp"
#include "ground_scale_vo/ros/warning_log.hpp"

namespace ground_scale_vo {

/// Subscribes to `image` (image_transport) and, without a camera file, to `camera_info`, and
/// rectifies the images. Both nodelets receive their images with it. It runs in the callback queue
/// of the node handle.
class ImageReceiver {
 public:
  struct Options {
    bool image_is_rectified = false;
    std::string mask_file, camera_file;  ///< of ImageRectifier
    std::string image_transport = "raw";
    std::uint32_t image_queue_size = 100;  ///< images that may wait for their callback
  };
  struct Handlers {
    /// Each image as it arrives, before any check; a compressed one after decoding.
    std::function<void(const sensor_msgs::ImageConstPtr&)> on_image;
    /// After each valid camera_info.
    std::function<void()> on_camera = [] {};
    /// Each message that is dropped, with the kind of the warning (WarningLog) and the reason.
    std::function<void(const std::string& kind, const std::string& reason)> on_drop;
    /// A sentence about input that is used although something is wrong with it, when it changes.
    std::function<void(const std::string& sentence)> on_warning;
    /// sourceError(), when it begins.
    std::function<void(const std::string& sentence)> on_error;
  };

  /// The transport `compressed` is decoded here; `raw_or_compressed` subscribes to both, where only
  /// one of them is published; any other one but `raw` needs its plugin, which may read parameters
  /// of private_handle. Throws OptionError when that is missing, and for a mask or camera file that
  /// cannot be used.
  ImageReceiver(ros::NodeHandle handle, const ros::NodeHandle& private_handle,
                const Options& options, Handlers handlers);
  ImageReceiver(const ImageReceiver&) = delete;
  ImageReceiver& operator=(const ImageReceiver&) = delete;

  /// Without a camera file, null before the first valid camera_info. A new object if and only if
  /// the calibration changed.
  const std::shared_ptr<const CalibratedCamera>& camera() const { return rectifier_.camera(); }

  /// Of the images that rectify() returns with camera(); see ImageRectifier.
  const cv::Mat& mask() const { return rectifier_.mask(); }
  /// [s] of the camera file; 0 without one.
  double readoutTime() const { return rectifier_.readoutTime(); }

  /// Rectified 8-bit grey; empty, after on_drop("image refused", …) or on_drop("image of another
  /// camera", …), for an image that cannot be used. It may refer to the data of the message.
  /// Precondition: camera() is not null.
  cv::Mat rectify(const sensor_msgs::Image& image);
  /// The same for the images that camera()->givenCalibration() describes, and their mask.
  cv::Mat given(const sensor_msgs::Image& image);
  const cv::Mat& givenMask() const { return rectifier_.givenMask(); }

  /// For images derived from the received ones.
  image_transport::ImageTransport& transport() { return transport_; }

  // For the diagnostics, both with images that are refused.
  std::uint64_t imagesReceived() const { return images_received_; }
  /// Wall time since the last image [s]; empty before the first.
  std::optional<double> secondsSinceImage() const;
  std::string imageTopic() const {
    return !image_subscriber_ || compressed_subscriber_.getNumPublishers() > 0
               ? compressed_subscriber_.getTopic()
               : image_subscriber_.getTopic();
  }
  std::string cameraInfoTopic() const { return camera_info_subscriber_.getTopic(); }
  /// "camera_info on topic T" or "parameter camera_file: FILE".
  std::string cameraSource() const;
  bool hasImagePublisher() const {
    return image_subscriber_.getNumPublishers() + compressed_subscriber_.getNumPublishers() > 0;
  }
  /// Why the last camera_info was refused; empty if it was accepted.
  const std::string& cameraInfoError() const { return camera_info_error_; }
  /// How image_is_rectified contradicts the last valid camera_info, in one sentence, or empty.
  const std::string& rectificationWarning() const { return rectification_warning_; }
  /// One sentence while two cameras publish on one topic or camera_info keeps changing, else empty.
  std::string sourceError() const;

 private:
  using Conversion = cv::Mat (ImageRectifier::*)(const sensor_msgs::Image&);
  cv::Mat convert(const sensor_msgs::Image& image, Conversion conversion);
  void reportSourceError();
  void checkRectification(const sensor_msgs::CameraInfo& info);
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void onCompressedImage(const sensor_msgs::CompressedImageConstPtr& compressed);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void countImage();

  const Handlers handlers_;
  const bool image_is_rectified_;
  ImageRectifier rectifier_;
  SourceGuard<std::string> sources_;  ///< of the images: frame_id and size
  std::uint64_t images_received_ = 0;
  std::optional<Stopwatch> since_image_;
  bool has_source_error_ = false;
  std::string camera_info_error_;
  std::string rectification_warning_;

  image_transport::ImageTransport transport_;
  ros::Subscriber camera_info_subscriber_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber compressed_subscriber_;  ///< with `compressed` and `raw_or_compressed`
};

}  // namespace ground_scale_vo
