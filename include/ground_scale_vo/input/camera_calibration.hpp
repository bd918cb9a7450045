#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/distortion_model.hpp"

namespace ground_scale_vo {

/// Intrinsics and distortion of a camera's images as they come. Rectified images have no
/// distortion, or the small one that the rectification has left in them.
struct CameraCalibration {
  using Pixels = DistortionModel::Points;

  int width = 0, height = 0;              ///< [px]; 0: not known, as in a KITTI calib.txt
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< [px]
  std::vector<double> distortion = {};    ///< coefficients of the model
  bool estimated = false;                 ///< from drives: PinholeCamera::lens_is_estimated
  double readout_time = 0;                ///< [s] of a rolling shutter; 0: global shutter
  bool is_part = false;    ///< of a larger image, whose principal point may lie anywhere
  cv::Size binning{1, 1};  ///< that is contained in the numbers above
  const DistortionModel* model = &distortionModels().front();

  bool hasSize() const { return width > 0 && height > 0; }
  bool isDistorted() const;
  /// The distortion is none or plumb_bob with at most 5 coefficients, which a Lens can hold.
  bool hasLens() const { return model->is_brown_conrady && distortion.size() <= 5; }

  /// The model by its name in ROS, Kalibr or OpenCV; "" or "none": coefficients that are all zero.
  /// Throws OptionError.
  void setDistortion(const std::string& name, const std::vector<double>& coefficients);

  /// Pixels of the images from those of the rectified ones with the same fx, fy, cx and cy, and
  /// vice versa.
  Pixels distorted(const Pixels& pixels) const { return mapped(model->distort, pixels); }
  Pixels undistorted(const Pixels& pixels) const { return mapped(model->undistort, pixels); }
  Pixels mapped(DistortionModel::Map* map, Pixels pixels) const;

  /// Throws OptionError that names the first number that is not finite or not plausible for a
  /// camera, or the wrong number of coefficients. The size is checked where it is known.
  void validate() const;

  /// Calibration of the part `roi` of the images, in which binning.width x binning.height pixels
  /// are combined into one. Throws OptionError: the part is not inside the image, or nothing is
  /// left.
  CameraCalibration ofPart(const cv::Rect2d& roi, const cv::Size& binning) const;

  /// "640x480, fx 500, fy 500, cx 320, cy 240, plumb_bob, D (-0.3, 0.1, 0, 0)".
  std::string describe() const;
};

bool operator==(const CameraCalibration& a, const CameraCalibration& b);

/// Without distortion.
CameraCalibration calibrationOf(const PinholeCamera& camera);
/// The distortion is ignored. Precondition: hasSize().
PinholeCamera pinholeOf(const CameraCalibration& calibration);

/// Without distortion, with square pixels and the principal point in the centre. degrees:
/// horizontal field of view. Throws OptionError.
CameraCalibration ofFieldOfView(double degrees, const cv::Size& size);

/// Whether a calibration can be that of images of this size. Where it has a size, that must be the
/// images'. Its principal point must not be that of images of another size: then it lies at the
/// centre of the image times one factor in both coordinates.
///
/// source: names the calibration in the sentences. Throws DataError with the likely size. Returns a
/// warning when the principal point is far from the centre of the image, as of cropped images, else
/// an empty text.
std::string checkCalibration(const CameraCalibration& calibration, const std::string& source,
                             const cv::Size& images);

}  // namespace ground_scale_vo
