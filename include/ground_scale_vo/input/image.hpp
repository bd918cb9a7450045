#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// Pixels as a sensor_msgs/Image stores them, with its field names. Does not own the data.
struct RawImage {
  std::uint32_t height = 0, width = 0;
  std::string encoding;  ///< of sensor_msgs
  bool is_bigendian = false;
  std::uint32_t step = 0;  ///< [bytes] of a row
  const std::uint8_t* data = nullptr;
  std::size_t bytes = 0;
};

/// The pixels without a copy, in the byte order of this machine (with a copy where it differs).
/// Throws DataError: no pixels, a side above kMaxImageSide, an encoding without a grey value, a
/// step that does not fit the width, data shorter or longer than step * height (of nv12 one and a
/// half times that).
cv::Mat pixelsOf(const RawImage& image);

/// The pixels of a whole PNG or JPEG image as they are stored, of 8 or 16 bits and 1, 3 (BGR) or 4
/// (BGRA) channels; the orientation in its metadata is ignored, since calibrations are of the
/// pixels. Zeros may follow the image, as cameras with MJPEG append them. Throws DataError, to
/// which the caller adds the name of the image: "is not a whole PNG or JPEG image", ....
cv::Mat decodePixels(std::string_view bytes);
/// The bytes of a PNG image, of 8 bits and 1 or 3 (BGR) channels.
std::string encodePng(const cv::Mat& pixels);

/// The Bayer pattern of decodePixels(), for GreyConverter, from the format of a
/// sensor_msgs/CompressedImage, such as "bayer_rggb8; jpeg compressed". Empty without one: decoded
/// colours are BGR, whatever their order was before the compression.
std::string bayerPatternOf(const std::string& format);

/// The pixels of a file. Throws DataError that names it: not readable, or as decodePixels().
cv::Mat readPixels(const std::filesystem::path& file);

/// The same as 8-bit grey, for a single image such as a mask. The images of a drive need one
/// GreyConverter for all.
cv::Mat readGreyImage(const std::filesystem::path& file);

/// Converts images to 8-bit grey. Encodings: mono, colour and Bayer of 8 or 16 bits, yuv422
/// (uyvy), yuv422_yuy2 (yuyv) and nv12; 8UC1 and 16UC1 count as mono, 8UC3 as bgr8, 8UC4 as bgra8,
/// and so on.
///
/// Most 16-bit cameras use fewer bits. The conversion to 8 bits divides by the range in use (8, 10,
/// 12, 14 or 16 bits), apart from the brightest 0.1 % of the pixels, which saturate: that of the
/// first image, wider as soon as a brighter image arrives, two bits narrower after
/// kImagesUntilNarrower images in a row that use at most half of the narrower range. So the
/// brightness does not flicker, and a result does not depend on later images. (The odometry follows
/// a gain change by a factor of four, see exposureStep().)
class GreyConverter {
 public:
  static constexpr int kImagesUntilNarrower = 100;

  /// An 8-bit mono image is not copied: the result refers to the image's data, which must outlive
  /// it. Throws DataError: pixelsOf().
  cv::Mat convert(const RawImage& image) { return convert(pixelsOf(image), image.encoding); }
  /// The same for pixels of 8 or 16 bits. encoding: empty for grey, BGR or BGRA by the number of
  /// channels; one that needs another type of pixels is ignored, as after a lossy compression.
  cv::Mat convert(const cv::Mat& pixels, const std::string& encoding = {});

 private:
  cv::Mat scaleToEightBits(const cv::Mat& grey);

  int bits_in_use_ = 8;
  int dark_images_ = 0;  ///< in a row, which use at most half of the next narrower range
};

/// An image as an odometry works on it. The mask is the same cv::Mat while the camera is the same.
struct CameraImage {
  cv::Mat grey;  ///< 8-bit, rectified; may refer to the data of the image it was made from
  cv::Mat mask;  ///< 0 where it never shows the scene; empty: no such region
  PinholeCamera camera;
};

/// Removes the distortion of a camera's images. The result has the same size, and fx, fy, cx and cy
/// of the calibration.
class Undistortion {
 public:
  /// mask: of the images as they come, 0 where they never show the scene; empty: no such region.
  /// Throws OptionError: the calibration is not valid or has no size, or the mask is not 8-bit with
  /// one channel and of that size.
  explicit Undistortion(const CameraCalibration& camera, const cv::Mat& mask = {});

  /// raw: 8-bit, one channel, of the camera's size (throws OptionError otherwise). Outside of it
  /// the result is black; it is `raw` itself if that has no distortion.
  CameraImage image(const cv::Mat& raw) const;

  const PinholeCamera& camera() const { return camera_; }
  /// 0 where the undistorted images have no content, or where that depends on a pixel where the
  /// mask of the images is 0; 255 elsewhere; empty: no such region.
  const cv::Mat& mask() const { return mask_; }

 private:
  cv::Mat remapped(const cv::Mat& raw) const;

  PinholeCamera camera_;
  cv::Mat map1_, map2_, mask_;
};

}  // namespace gsv
