#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/image.hpp"

// The images of MonoVo and their calibration.
namespace gsv {

/// Detects that the description of the source in the messages keeps changing, as of two cameras on
/// one topic: the third change keeps the source in use until kMemory messages in a row agree.
template <typename Source>
class SourceGuard {
 public:
  using IsSame = std::function<bool(const Source&, const Source&)>;

  /// [messages] After this many of one source in a row, the others are forgotten.
  static constexpr int kMemory = 100;
  /// The source changes for this many times; further changes are not followed.
  static constexpr int kMaxChanges = 2;

  explicit SourceGuard(IsSame is_same = std::equal_to<Source>()) : is_same_(std::move(is_same)) {}

  /// Whether a message of this source is used; if it is not that in use, it is so from now on.
  bool accepts(const Source& source) {
    run_ = last_ && is_same_(*last_, source) ? run_ + 1 : 1;
    last_ = source;
    const bool has_settled = run_ >= kMemory;
    if (has_settled) {
      changes_ = 0;
      refused_.reset();
    }
    if (current_ && is_same_(*current_, source)) return true;
    if (current_ && changes_ >= kMaxChanges) {
      refused_ = source;
      return false;
    }
    if (current_ && !has_settled) ++changes_;
    current_ = source;
    return true;
  }

  /// The source in use. Precondition: accepts() was called.
  const Source& current() const { return *current_; }
  /// The last one that was refused; empty: the description does not keep changing.
  const std::optional<Source>& refused() const { return refused_; }

 private:
  const IsSame is_same_;
  std::optional<Source> current_, last_, refused_;
  int run_ = 0;      ///< messages of last_ in a row
  int changes_ = 0;  ///< of current_ since a source was settled
};

/// The calibration of a camera, from a camera file or from the latest valid camera_info, and its
/// images as 8-bit grey. While camera_info keeps changing (SourceGuard), one calibration stays in
/// use.
class CameraInput {
 public:
  /// mask_file: image file of the images' size, black where they never show the scene; empty: no
  /// such region. camera_file: readCameraFile(); camera_info and image_is_rectified are not used
  /// then; empty: camera_info. Throws OptionError that names the parameter (mask, camera_file) and
  /// the file.
  explicit CameraInput(bool image_is_rectified, const std::string& mask_file = {},
                       const std::string& camera_file = {});

  /// Throws DataError that names the topic, also while the calibration keeps changing and for
  /// one whose image size the mask does not have; the previous calibration stays in use then.
  /// image_topic: for warning(). Precondition: no camera file.
  void setCameraInfo(const sensor_msgs::CameraInfo& info, const std::string& topic,
                     const std::string& image_topic = {});

  /// Of the images as they come. Without a camera file, null before the first valid camera_info. A
  /// new object if and only if the calibration changed.
  const std::shared_ptr<const CameraCalibration>& camera() const { return camera_; }
  /// Of the images as they come; empty: none.
  const cv::Mat& mask() const { return mask_; }
  /// How image_is_rectified contradicts the last valid camera_info, or what is suspicious about the
  /// calibration; or empty.
  const std::string& warning() const { return warning_; }
  /// One sentence while camera_info keeps changing, else empty.
  std::string calibrationError() const;

  /// As it comes; GreyConverter::convert(). Throws DataError: not the size of the calibration.
  /// Precondition: camera() is not null.
  cv::Mat grey(const cv::Mat& pixels, const std::string& encoding = {});

 private:
  std::string check(const CameraCalibration& calibration) const;

  const bool image_is_rectified_;
  const std::string mask_name_;  ///< for errors
  const cv::Mat mask_;
  std::string source_;  ///< of camera_: "camera_info on topic T" or "parameter camera_file: FILE"
  std::string warning_;
  std::shared_ptr<const CameraCalibration> camera_;
  SourceGuard<CameraCalibration> calibrations_{isSameCalibration};
  GreyConverter grey_converter_;
};

}  // namespace gsv
