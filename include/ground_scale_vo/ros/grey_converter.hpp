#pragma once

#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>

namespace ground_scale_vo {

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

  /// An 8-bit mono image is not copied: the result refers to the message's data, which must outlive
  /// it. Throws MessageError: no pixels, a side above kMaxImageSide, an encoding without a grey
  /// value, a step that does not fit the width, data shorter or longer than step * height.
  cv::Mat convert(const sensor_msgs::Image& image);

 private:
  cv::Mat scaleToEightBits(const cv::Mat& grey);

  int bits_in_use_ = 8;
  int dark_images_ = 0;  ///< in a row, which use at most half of the next narrower range
};

}  // namespace ground_scale_vo
