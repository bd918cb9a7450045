#include "ground_scale_vo/ros/grey_converter.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdint>
#include <map>
#include <opencv2/imgproc.hpp>
#include <string>

#include "ground_scale_vo/common/image_limits.hpp"
#include "ground_scale_vo/ros/message_error.hpp"

namespace ground_scale_vo {
namespace {

namespace encodings = sensor_msgs::image_encodings;

/// Share of the pixels that may be brighter than the range: defective ones, and reflections.
constexpr double kMaxShareOutOfRange = 0.001;

/// Unknown to cv_bridge and, in ROS 1, to sensor_msgs.
const std::string kYuy2 = "yuv422_yuy2";

/// The encoding by which cv_bridge converts an image to grey. Channels without a meaning are read
/// as OpenCV orders them: one is grey, three or four are blue, green, red (and alpha). Throws
/// MessageError for an encoding without a grey value.
std::string sourceEncoding(const std::string& encoding) {
  static const std::map<std::string, std::string> kGeneric = {
      {encodings::TYPE_8UC1, encodings::MONO8},  {encodings::TYPE_8UC3, encodings::BGR8},
      {encodings::TYPE_8UC4, encodings::BGRA8},  {encodings::TYPE_16UC1, encodings::MONO16},
      {encodings::TYPE_16UC3, encodings::BGR16}, {encodings::TYPE_16UC4, encodings::BGRA16}};
  if (const auto generic = kGeneric.find(encoding); generic != kGeneric.end()) {
    return generic->second;
  }
  if (encodings::isMono(encoding) || encodings::isColor(encoding) || encodings::isBayer(encoding) ||
      encoding == encodings::YUV422 || encoding == kYuy2) {
    return encoding;
  }
  throw MessageError("the encoding \"" + encoding +
                     "\" cannot be converted to grey; supported are mono, colour and Bayer of 8 or "
                     "16 bits, yuv422 and yuv422_yuy2");
}

/// Throws MessageError. cv_bridge checks the sizes too, but in 32 bits, which overflow.
void requireWholeImage(const sensor_msgs::Image& image, std::size_t channel_bytes,
                       std::size_t channels) {
  const std::size_t step = image.step;
  if (step < image.width * channel_bytes * channels || step % channel_bytes != 0) {
    throw MessageError("the step of " + std::to_string(step) + " bytes does not fit " +
                       std::to_string(image.width) + " pixels of " + image.encoding);
  }
  if (image.data.size() != step * image.height) {
    throw MessageError("the image holds " + std::to_string(image.data.size()) +
                       " bytes instead of " + std::to_string(step * image.height));
  }
}

/// The pixels of the message without a copy.
cv::Mat pixelsOf(const sensor_msgs::Image& image, int type) {
  // cv::Mat has no constant pixels; nobody writes to these.
  return {static_cast<int>(image.height), static_cast<int>(image.width), type,
          const_cast<std::uint8_t*>(image.data.data()), image.step};
}

/// Other byte order of 16-bit pixels, in new memory. (cv_bridge 1.16 swaps them too, but returns
/// 8-bit pixels of twice as many channels.)
cv::Mat swapBytes(const cv::Mat& pixels) {
  cv::Mat swapped = pixels.clone();
  const int row_numbers = swapped.cols * swapped.channels();
  for (int row = 0; row < swapped.rows; ++row) {
    auto* const first = swapped.ptr<std::uint16_t>(row);
    std::transform(first, first + row_numbers, first,
                   [](std::uint16_t n) { return static_cast<std::uint16_t>(n << 8 | n >> 8); });
  }
  return swapped;
}

}  // namespace

cv::Mat GreyConverter::convert(const sensor_msgs::Image& image) {
  if (image.width == 0 || image.height == 0) throw MessageError("the image has no pixels");
  if (image.width > kMaxImageSide || image.height > kMaxImageSide) {
    throw MessageError("the image size " + std::to_string(image.width) + " x " +
                       std::to_string(image.height) + " is not plausible for a camera");
  }
  const std::string encoding = sourceEncoding(image.encoding);
  if (encoding == kYuy2) {
    requireWholeImage(image, 1, 2);
    cv::Mat grey;
    cv::cvtColor(pixelsOf(image, CV_8UC2), grey, cv::COLOR_YUV2GRAY_YUY2);
    return grey;
  }
  const bool has_16_bits = encodings::bitDepth(encoding) == 16;
  const int channels = encodings::numChannels(encoding);
  requireWholeImage(image, has_16_bits ? 2 : 1, static_cast<std::size_t>(channels));
  if (encoding == encodings::MONO8) return pixelsOf(image, CV_8UC1);

  cv::Mat native = pixelsOf(image, CV_MAKETYPE(has_16_bits ? CV_16U : CV_8U, channels));
  if (has_16_bits && image.is_bigendian != 0) native = swapBytes(native);
  const auto source = boost::make_shared<cv_bridge::CvImage>(image.header, encoding, native);
  const cv_bridge::CvImagePtr grey =
      cv_bridge::cvtColor(source, has_16_bits ? encodings::MONO16 : encodings::MONO8);
  return has_16_bits ? scaleToEightBits(grey->image) : grey->image;
}

cv::Mat GreyConverter::scaleToEightBits(const cv::Mat& grey) {
  const double allowed = kMaxShareOutOfRange * static_cast<double>(grey.total());
  const auto fitsIn = [&](int bits) {
    return cv::countNonZero(grey >= std::ldexp(1.0, bits)) <= allowed;
  };
  while (bits_in_use_ < 16 && !fitsIn(bits_in_use_)) bits_in_use_ += 2;
  // One bit less than the narrower range, so that a change of the light does not widen it again.
  dark_images_ = bits_in_use_ > 8 && fitsIn(bits_in_use_ - 3) ? dark_images_ + 1 : 0;
  if (dark_images_ == kImagesUntilNarrower) {
    bits_in_use_ -= 2;
    dark_images_ = 0;
  }
  cv::Mat eight_bits;
  grey.convertTo(eight_bits, CV_8U, 255 / (std::ldexp(1.0, bits_in_use_) - 1));
  return eight_bits;
}

}  // namespace ground_scale_vo
