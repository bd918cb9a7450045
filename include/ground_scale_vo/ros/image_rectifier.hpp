#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "ground_scale_vo/input/calibrated_camera.hpp"
#include "ground_scale_vo/input/grey_converter.hpp"
#include "ground_scale_vo/ros/source_guard.hpp"

namespace ground_scale_vo {

/// Converts the images of one camera to rectified 8-bit grey, by a camera file or by the latest
/// valid camera_info. While it keeps changing (SourceGuard), one calibration stays in use.
class ImageRectifier {
 public:
  /// image_is_rectified: the images have no distortion, and P of camera_info belongs to them.
  /// mask_file: image file of their size before rectification, black where they never show the
  /// scene; empty: no such region. camera_file: describes the images as they come
  /// (readCameraFile()); camera_info and image_is_rectified are not used then; empty: camera_info.
  /// Throws OptionError that names the parameter (mask, camera_file) and the file.
  explicit ImageRectifier(bool image_is_rectified, const std::string& mask_file = {},
                          const std::string& camera_file = {});

  /// Throws DataError that names the topic, also while the calibration keeps changing and for
  /// one whose image size is not that of the mask; the previous calibration stays in use then.
  /// Precondition: no camera file.
  void setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic);

  /// Without a camera file, null before the first valid camera_info. A new object if and only if
  /// the calibration changed.
  const std::shared_ptr<const CalibratedCamera>& camera() const { return camera_; }
  /// Mask of the rectified images (Undistortion::mask()); the same cv::Mat while camera() is the
  /// same. Empty when it masks nothing.
  const cv::Mat& mask() const { return mask_; }
  /// Of camera(): "camera_info" or "parameter camera_file: FILE".
  const std::string& source() const { return source_; }
  /// [s] of the camera file; 0 without one.
  double readoutTime() const { return readout_time_; }
  /// What is suspicious about camera() (checkCalibration()), or empty.
  const std::string& calibrationWarning() const { return calibration_warning_; }
  /// That the calibration on the topic keeps changing, in one sentence; empty: it does not.
  std::string calibrationError(const std::string& topic) const;

  /// 8-bit grey, rectified. Refers to the message's data if nothing has to be converted. Throws
  /// DataError: GreyConverter's reasons, or not the size of the calibration. Precondition: camera()
  /// is not null.
  cv::Mat rectify(const sensor_msgs::Image& image);
  /// The same for the images that CalibratedCamera::givenCalibration() describes.
  cv::Mat given(const sensor_msgs::Image& image);
  const cv::Mat& givenMask() const { return given_mask_; }

 private:
  cv::Mat toGrey(const sensor_msgs::Image& image);
  void readCamera(const std::string& file);
  void use(std::shared_ptr<const CalibratedCamera> camera);

  const bool image_is_rectified_;
  const std::string mask_name_;  ///< of raw_mask_, for errors
  const cv::Mat raw_mask_;
  cv::Mat mask_, given_mask_;
  double readout_time_ = 0;
  std::string source_ = "camera_info", calibration_warning_;
  std::shared_ptr<const CalibratedCamera> camera_;
  SourceGuard<CameraCalibration> calibrations_{isSameCalibration};
  GreyConverter grey_converter_;
};

}  // namespace ground_scale_vo
