#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>

#include "common/source_guard.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "input/camera_info.hpp"

namespace gsv {

/// The images of a topic of the nodelets or of a bag as 8-bit grey, and the calibration of their
/// camera, from a file or from the latest valid camera_info, in the order in which they come. While
/// camera_info or the frame_id of the images keeps changing (SourceGuard), one camera stays in use.
class CameraInput {
 public:
  /// mask: of the images' size, 0 where they never show the scene; empty: no such region.
  /// mask_name: for errors.
  explicit CameraInput(bool image_is_rectified, const cv::Mat& mask = {},
                       std::string mask_name = "the mask")
      : image_is_rectified_(image_is_rectified), mask_(mask), mask_name_(std::move(mask_name)) {}

  /// Throws DataError that names the source, also while the calibration keeps changing and for one
  /// whose image size the mask does not have; the previous calibration stays in use then. One
  /// without a size has that of the images: if there is none yet, grey() begins with it.
  void setCalibration(const CameraCalibration& calibration, const std::string& source);
  /// The same for a camera_info. image_topic: for warning().
  void setCameraInfo(const CameraInfo& info, const std::string& topic,
                     const std::string& image_topic = {});

  /// There is a calibration for the next image: camera(), or one without a size.
  bool isReady() const { return camera_ || unsized_; }
  const std::optional<CameraCalibration>& unsized() const { return unsized_; }

  /// Of the images as they come; null before the first valid calibration with a size. A new object
  /// if and only if the next image does not continue the ones before it: calibration or frame_id
  /// changed.
  const std::shared_ptr<const CameraCalibration>& camera() const { return camera_; }
  const cv::Mat& mask() const { return mask_; }
  /// How image_is_rectified contradicts the last valid camera_info, or what is suspicious about the
  /// calibration; or empty.
  const std::string& warning() const { return warning_; }
  /// One sentence while camera_info keeps changing, else empty.
  std::string calibrationError() const;
  /// One sentence while the images are of two cameras, or calibrationError(), else empty.
  std::string sourceError(const std::string& image_topic) const;

  /// GreyConverter::convert(). Throws DataError: not the size of the calibration. Precondition:
  /// isReady().
  cv::Mat grey(const cv::Mat& pixels, const std::string& encoding = {});
  /// Whether an image that can be used is of the camera in use; else sourceError() says why not.
  bool isOfCamera(const std::string& frame_id);

 private:
  const bool image_is_rectified_;
  const cv::Mat mask_;
  const std::string mask_name_;
  std::string source_, warning_;  ///< of camera_
  std::shared_ptr<const CameraCalibration> camera_;
  std::optional<CameraCalibration> unsized_;  ///< without a size, while there is no camera_
  SourceGuard<CameraCalibration> calibrations_{isSameCalibration};
  SourceGuard<std::string> frame_ids_;
  GreyConverter grey_converter_;
};

}  // namespace gsv
