#pragma once

#include <opencv2/core.hpp>

#include "ground_scale_vo/input/camera_calibration.hpp"

namespace ground_scale_vo {

/// Removes the distortion of images; the result is a pinhole camera with the same size, fx, fy, cx
/// and cy.
class Undistortion {
 public:
  /// Precondition: the calibration is valid and has a size.
  explicit Undistortion(const CameraCalibration& camera);

  /// image: of the camera's size (throws DataError otherwise). Outside of it the result is black.
  cv::Mat image(const cv::Mat& image) const;
  /// 0 where the undistorted image has no content, 255 elsewhere; empty when it has all.
  const cv::Mat& mask() const { return mask_; }
  /// The same, and 0 where the content depends on a pixel where a mask of the given images is 0
  /// (empty: no such region).
  cv::Mat mask(const cv::Mat& given) const;

 private:
  cv::Size size_;
  cv::Mat map1_, map2_, mask_;
};

/// A calibration and the rectification by it. Immutable.
class CalibratedCamera {
 public:
  /// Throws OptionError: not valid, or without a size.
  explicit CalibratedCamera(const CameraCalibration& calibration);

  const CameraCalibration& calibration() const { return calibration_; }
  /// Intrinsics of the rectified images, which have the size of the raw ones.
  PinholeCamera camera() const { return pinholeOf(calibration_); }
  const Undistortion& undistortion() const { return undistortion_; }

  /// The images with which an odometry works that may refine the lens: the raw ones if a Lens holds
  /// their distortion, else the rectified ones. Their calibration, and they from the raw ones.
  const CameraCalibration& givenCalibration() const { return given_; }
  bool isGivenRectified() const { return !calibration_.hasLens(); }
  cv::Mat given(const cv::Mat& raw) const;
  /// Mask of the given images from that of the raw ones.
  cv::Mat givenMask(const cv::Mat& raw_mask) const;

 private:
  CameraCalibration calibration_, given_;
  Undistortion undistortion_;
};

/// Same calibration: same image size, and both rectify an image to the same intrinsics and from the
/// same raw pixels, within 0.1 px: publishers that round differently, or another odometry, describe
/// the same camera with differences below this, which is far below the error of a calibration.
bool isSameCalibration(const CameraCalibration& a, const CameraCalibration& b);

}  // namespace ground_scale_vo
