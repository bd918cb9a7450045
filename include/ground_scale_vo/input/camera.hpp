#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace gsv {

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
  /// Standard deviation of the radial distortion k1 that these images may still have; 0: not known.
  double k1_sigma = 0;

  /// The same, or what is usual.
  double k1Sigma() const;

  /// Throws OptionError that names the first number that is not finite or not plausible.
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

struct DistortionModel;
const DistortionModel& plumbBob();

/// Intrinsics and distortion of a camera's images as they come. Rectified images have no
/// distortion, or the small one that the rectification has left in them.
struct CameraCalibration {
  using Pixels = std::vector<cv::Point2d>;

  int width = 0, height = 0;              ///< [px]; 0: not known, as in a KITTI calib.txt
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< [px]
  std::vector<double> distortion = {};    ///< coefficients of the model
  bool estimated = false;                 ///< from drives: PinholeCamera::lens_is_estimated
  double k1_sigma = 0;                    ///< that of PinholeCamera
  double readout_time = 0;                ///< [s] of a rolling shutter; 0: global shutter
  bool is_part = false;    ///< of a larger image, whose principal point may lie anywhere
  cv::Size binning{1, 1};  ///< that is contained in the numbers above
  const DistortionModel* model = &plumbBob();

  bool hasSize() const { return width > 0 && height > 0; }
  bool isDistorted() const;
  /// The distortion is none or plumb_bob with at most 5 coefficients.
  bool isPlumbBob() const;

  /// The model by its name in ROS, Kalibr or OpenCV. Coefficients that are all zero need none (""
  /// or "none"), and five or more without one are those of plumb_bob.
  /// Throws OptionError.
  void setDistortion(const std::string& name, const std::vector<double>& coefficients);

  /// Pixels of the images from those of the rectified ones with the same fx, fy, cx and cy, and
  /// vice versa.
  Pixels distorted(const Pixels& pixels) const;
  Pixels undistorted(const Pixels& pixels) const;

  /// Throws OptionError that names the first number that is not finite or not plausible for a
  /// camera, or the wrong number of coefficients. The size is checked where it is known.
  void validate() const;

  /// "640x480, fx 500, fy 500, cx 320, cy 240, plumb_bob, D (-0.3, 0.1, 0, 0)".
  std::string describe() const;
};

/// Same image size, and both rectify an image to the same intrinsics and from the same raw pixels,
/// within 0.1 px: publishers that round differently describe the same camera with such differences,
/// which are far below the error of a calibration.
bool isSameCalibration(const CameraCalibration& a, const CameraCalibration& b);

/// The calibration of images that have no distortion.
CameraCalibration withoutDistortion(const PinholeCamera& camera);
/// The camera of the rectified images. Precondition: hasSize().
PinholeCamera pinholeOf(const CameraCalibration& calibration);

/// Throws DataError, with the likely size, when a calibration cannot be that of images of this
/// size: it has another one, or its principal point is the centre of the image times one factor in
/// both coordinates; or it has none, and its principal point is not near the centre. Returns a
/// warning when the principal point is far from the centre, as of cropped images, else an empty
/// text. source: names the calibration.
std::string checkCalibration(const CameraCalibration& calibration, const std::string& source,
                             const cv::Size& images);

}  // namespace gsv
