#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <string>

namespace ground_scale_vo {

/// What in camera_info or in the name of the image topic contradicts image_is_rectified.
struct RectificationContradiction {
  std::string reason;  ///< a clause; empty: no contradiction, or there is nothing to compare
  /// P cannot belong to raw images of K and D: no calibration computes it for them. Otherwise a
  /// hint: a name; P of a fisheye camera, which may show any part of the image; or P that equals K,
  /// as of images that cv::undistort rectified.
  bool is_certain = false;
};

/// Precondition: CalibratedCamera accepts the info.
RectificationContradiction rectificationContradiction(const sensor_msgs::CameraInfo& info,
                                                      bool image_is_rectified,
                                                      const std::string& image_topic);

}  // namespace ground_scale_vo
