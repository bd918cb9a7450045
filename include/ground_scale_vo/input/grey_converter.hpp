#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>

namespace ground_scale_vo {

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
/// step that does not fit the width, data shorter or longer than step * height.
cv::Mat pixelsOf(const RawImage& image);

/// Converts images to 8-bit grey. Encodings: mono, colour and Bayer of 8 or 16 bits, yuv422 and
/// yuv422_yuy2; 8UC1 and 16UC1 count as mono, 8UC3 as bgr8, 8UC4 as bgra8, and so on.
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

}  // namespace ground_scale_vo
