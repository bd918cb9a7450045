#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// The fields of a sensor_msgs/CameraInfo under their names.
struct CameraInfo {
  std::uint32_t height = 0, width = 0;
  std::string distortion_model;
  std::vector<double> D;
  std::array<double, 9> K = {}, R = {};
  std::array<double, 12> P = {};
  std::uint32_t binning_x = 0, binning_y = 0;
  struct {
    std::uint32_t x_offset = 0, y_offset = 0, height = 0, width = 0;
  } roi;
};

/// The calibration of the images that a camera_info describes, with ROI and binning.
///
/// Uses K and D; P if K is all zero, as for a rectified camera, or if image_is_rectified states
/// that the images are rectified although K and D describe the raw camera. R and the last column of
/// P are not used: the axes are those of the images as they come. A camera_info with a width and
/// height of zero, as some drivers publish it, has no size, ROI and binning. Throws DataError that
/// names the topic and what cannot be used.
CameraCalibration readCameraInfo(const CameraInfo& info, const std::string& topic,
                                 bool image_is_rectified);

/// What in camera_info or in the name of the image topic contradicts image_is_rectified.
struct RectificationContradiction {
  std::string reason;  ///< a clause; empty: no contradiction, or there is nothing to compare
  /// P cannot belong to raw images of K and D: no calibration computes it for them. Otherwise a
  /// hint: a name; P of a wide-angle model, which may show any part of the image; or P that equals
  /// K, as of images that cv::undistort rectified.
  bool is_certain = false;
};

/// Precondition: readCameraInfo() accepts the info.
RectificationContradiction rectificationContradiction(const CameraInfo& info,
                                                      bool image_is_rectified,
                                                      const std::string& image_topic);

}  // namespace gsv
