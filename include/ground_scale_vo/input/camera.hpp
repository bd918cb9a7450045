#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>

namespace ground_scale_vo {

/// Largest side [px] and number of pixels of an image; a larger one is an error of the sender. The
/// limits keep products of sizes within their types and an 8-bit grey image within 100 MB.
constexpr std::uint32_t kMaxImageSide = 100000;
constexpr double kMaxImagePixels = 1e8;

/// A camera without distortion. Pixel convention: the centre of the upper left pixel is (0, 0).
/// Camera axes: x right, y down, z forward (REP-103 optical).
struct PinholeCamera {
  int width = 0;   ///< [px]
  int height = 0;  ///< [px]
  double fx = 0;   ///< [px]
  double fy = 0;   ///< [px]
  double cx = 0;   ///< [px]
  double cy = 0;   ///< [px]
  /// The distortion that was removed from the images was estimated from drives (LensEstimator), not
  /// only calibrated: the shape of the road is observable. Otherwise what a calibration has left of
  /// the distortion looks like a curved road.
  bool lens_is_estimated = false;

  /// Throws OptionError that names the first number that is not finite or not plausible: a side
  /// outside 1 to kMaxImageSide px, a focal length outside 1 to 10 kMaxImageSide px, a principal
  /// point beyond kMaxImageSide px.
  void validate() const;

  /// x = K^-1 u with z = 1 (the ray of the paper's Alg. 1, line 7). u: [px].
  Eigen::Vector3d ray(const Eigen::Vector2d& u) const {
    return {(u.x() - cx) / fx, (u.y() - cy) / fy, 1.0};
  }
  /// K p_c / z [px]. Precondition: p_c.z() > 0.
  Eigen::Vector2d project(const Eigen::Vector3d& p_c) const {
    return {fx * p_c.x() / p_c.z() + cx, fy * p_c.y() / p_c.z() + cy};
  }
  /// Time at which a rolling shutter exposes row v after the middle row, as a share of the readout
  /// time: -0.5 at the upper, 0.5 at the lower border of the image.
  double readoutShare(double v) const { return (v + 0.5) / height - 0.5; }
};

/// All numbers are equal.
bool isSameCamera(const PinholeCamera& a, const PinholeCamera& b);

/// Throws OptionError unless image is 8-bit with one channel and of the camera's size.
void requireImage(const cv::Mat& image, const PinholeCamera& camera);

/// The same for a mask of image regions that never show the scene (0; other values: scene), which
/// may be empty (no such region). name: of the mask, for the error.
void requireMask(const cv::Mat& mask, const PinholeCamera& camera,
                 const std::string& name = "the mask");

}  // namespace ground_scale_vo
