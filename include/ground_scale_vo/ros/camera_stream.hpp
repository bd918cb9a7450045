#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// A camera as one camera_info described it. Never changes.
class CalibratedCamera {
 public:
  /// Throws MessageError, which names the topic of the calibration.
  CalibratedCamera(Calibration calibration, const std::string& topic);

  const Calibration& calibration() const { return calibration_; }
  /// Of the rectified images.
  const PinholeCamera& camera() const { return rectifier_.camera(); }
  /// 8-bit grey; may be the message's own pixels, as GreyConverter's are. Throws MessageError: its
  /// reasons, or not of the calibration's size.
  cv::Mat rectified(const sensor_msgs::Image& image, GreyConverter* grey) const;
  /// The other camera is that of the rectified images, give or take the digits of a float.
  bool isCameraOf(const PinholeCamera& other) const;

 private:
  Calibration calibration_;
  Rectifier rectifier_;
};

/// The camera that the camera_info beside a stream of images describes. Thread safe.
class CameraStream {
 public:
  explicit CameraStream(bool image_is_rectified) : image_is_rectified_(image_is_rectified) {}

  /// Throws MessageError, which names the topic; the camera before stays in use then.
  void accept(const sensor_msgs::CameraInfo& info, const std::string& topic);

  /// Null until one was accepted; another object if and only if the calibration changed.
  std::shared_ptr<const CalibratedCamera> camera() const;

 private:
  const bool image_is_rectified_;
  mutable std::mutex mutex_;
  std::shared_ptr<const CalibratedCamera> camera_;
};

}  // namespace ground_scale_vo
