#pragma once

#include <array>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>

namespace ground_scale_vo {

/// Intrinsics and plumb_bob distortion of a camera's images, as ROS' camera_calibration stores
/// them. Images that are rectified already have the small distortion that is left in them.
struct CameraCalibration {
  int width = 0, height = 0;              ///< [px]
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< [px]
  std::array<double, 5> distortion = {};  ///< k1, k2, p1, p2, k3
  bool estimated = false;                 ///< from drives: PinholeCamera::lens_is_estimated
  double readout_time = 0;                ///< [s] of a rolling shutter; 0: global shutter
};

bool operator==(const CameraCalibration& a, const CameraCalibration& b);

/// Reads the YAML of camera_calibration: image_width, image_height, camera_matrix,
/// distortion_model (plumb_bob), distortion_coefficients; and two keys of this project, which may
/// be missing: estimated_from_drives (true), readout_time [s]. Rectification and projection matrix
/// are not used: a single camera needs none, its undistorted images keep the camera matrix. Throws
/// DataError that names the file.
CameraCalibration readCameraFile(const std::filesystem::path& file);

/// That YAML. comment: lines for its head, without '#'.
std::string cameraYaml(const CameraCalibration& camera, const std::string& comment);

/// Removes the distortion of images; the result is a pinhole camera with the same fx, fy, cx, cy.
class Undistortion {
 public:
  explicit Undistortion(const CameraCalibration& camera);

  /// image: of the camera's size (throws DataError otherwise). Outside of it the result is black.
  cv::Mat image(const cv::Mat& image) const;
  /// 0 where the undistorted image has no content, 255 elsewhere; empty when it has all.
  const cv::Mat& mask() const { return mask_; }
  /// The same, and 0 where a mask of the given images is 0 (empty: no such region).
  cv::Mat mask(const cv::Mat& given) const;

 private:
  cv::Size size_;
  cv::Mat map1_, map2_, mask_;
};

}  // namespace ground_scale_vo
