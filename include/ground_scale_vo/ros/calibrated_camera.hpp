#pragma once

#include <image_geometry/pinhole_camera_model.h>
#include <sensor_msgs/CameraInfo.h>

#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

/// The camera that a CameraInfo describes: intrinsics of its images and their rectification, by
/// image_geometry. Immutable.
///
/// Uses K and D; P if K is all zero, as for a rectified camera, or if image_is_rectified states
/// that the images are rectified although K and D describe the raw camera. ROI and binning are
/// applied. R and the last column of P are not used: the axes are those of the given images (for
/// images that are already rectified with R, the rotated ones).
class CalibratedCamera {
 public:
  /// topic: for the error. Throws MessageError that names it: not calibrated (K and P all zero; P
  /// with image_is_rectified), a K or P that is not that of a pinhole camera, a number that is not
  /// finite, implausible intrinsics; where K and D are used, an unknown distortion model, a wrong
  /// number of coefficients or implausible ones; an ROI outside the image, a binning of all of it.
  CalibratedCamera(const sensor_msgs::CameraInfo& info, const std::string& topic,
                   bool image_is_rectified);
  /// The camera of a camera file, with its lens_is_estimated. Throws OptionError: implausible
  /// intrinsics or coefficients.
  explicit CalibratedCamera(const CameraCalibration& calibration);

  /// Intrinsics of the rectified images, which have the size of the raw ones.
  const PinholeCamera& camera() const { return camera_; }
  bool isDistorted() const { return is_distorted_; }
  /// raw: 8-bit, one channel, the camera's size (throws OptionError otherwise). Without distortion
  /// the result is raw itself.
  cv::Mat rectify(const cv::Mat& raw) const;

  /// Mask of the rectified images from that of the raw ones (as requireMask(); 0: masked): masked
  /// are the pixels that depend on a masked raw pixel or lie outside the raw image. Without
  /// distortion the result is the mask itself; empty stays empty.
  cv::Mat rectifyMask(const cv::Mat& mask) const;

  /// The lens that refine_camera refines, and the images that it describes: the raw ones if their
  /// distortion is plumb_bob with at most 5 coefficients, else the rectified ones.
  const CameraCalibration& givenCalibration() const { return given_; }
  bool isGivenRectified() const { return is_given_rectified_; }
  cv::Mat given(const cv::Mat& raw) const { return is_given_rectified_ ? rectify(raw) : raw; }

  /// Same calibration: same image size, and both rectify an image to the same intrinsics and from
  /// the same raw pixels, within kTolerancePx.
  bool isSameAs(const CalibratedCamera& other) const;
  /// Same image size and, within kTolerancePx, same intrinsics.
  bool matches(const PinholeCamera& other) const;
  /// "640 x 480, fx 500, fy 500, cx 320, cy 240, plumb_bob, D (-0.3, 0.1, 0, 0)".
  std::string describe() const;

  /// [px] Publishers that round differently, or another odometry, describe the same camera with
  /// differences below this. They are far below the error of a calibration.
  static constexpr double kTolerancePx = 0.1;

 private:
  /// info: with R = I and P = [K | 0]. Throws OptionError.
  void set(const sensor_msgs::CameraInfo& info);

  image_geometry::PinholeCameraModel model_;
  PinholeCamera camera_;
  bool is_distorted_ = false;
  CameraCalibration given_;
  bool is_given_rectified_ = false;
};

/// camera_info of a rectified camera: K and P filled, D zero. For writing bags.
sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera);

}  // namespace ground_scale_vo
