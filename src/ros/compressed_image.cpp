#include "ground_scale_vo/ros/compressed_image.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <string_view>

#include "ground_scale_vo/common/encoded_image.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/message_error.hpp"

namespace ground_scale_vo {
namespace {

/// The encoding of decoded pixels. `format` begins with the encoding before the compression, such
/// as "bayer_rggb8; jpeg compressed".
std::string encodingOf(const cv::Mat& pixels, const std::string& format) {
  const bool has_16_bits = pixels.depth() == CV_16U;
  const std::string source = format.substr(0, format.find(';'));
  if (pixels.channels() == 1 && sensor_msgs::image_encodings::isBayer(source) &&
      (sensor_msgs::image_encodings::bitDepth(source) == 16) == has_16_bits) {
    return source;
  }
  const std::string bits = has_16_bits ? "16" : "8";
  if (pixels.channels() == 1) return "mono" + bits;
  return (pixels.channels() == 3 ? "bgr" : "bgra") + bits;
}

}  // namespace

sensor_msgs::ImagePtr decode(const sensor_msgs::CompressedImage& image) {
  const std::string_view bytes(reinterpret_cast<const char*>(image.data.data()), image.data.size());
  const std::string name = "the compressed image (format \"" + image.format + "\", " +
                           std::to_string(bytes.size()) + " bytes) ";
  try {
    requireDecodable(bytes);
  } catch (const DataError& error) {
    throw MessageError(name + error.what());
  }
  cv::Mat pixels;
  try {
    pixels = cv::imdecode(image.data, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    pixels.release();
  }
  const bool has_integers = pixels.depth() == CV_8U || pixels.depth() == CV_16U;
  if (pixels.empty() || !has_integers || pixels.channels() == 2) {
    throw MessageError(name + "cannot be decoded");
  }
  return cv_bridge::CvImage(image.header, encodingOf(pixels, image.format), pixels).toImageMsg();
}

}  // namespace ground_scale_vo
