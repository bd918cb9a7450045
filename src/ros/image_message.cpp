#include "ground_scale_vo/ros/image_message.hpp"

#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <string_view>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/image_file.hpp"

namespace ground_scale_vo {
namespace {

/// Of decoded pixels: a Bayer pattern, which the compression has kept, or the channels of OpenCV.
std::string encodingOf(const cv::Mat& pixels, const std::string& format) {
  namespace encodings = sensor_msgs::image_encodings;
  const std::string source = bayerPatternOf(format);
  const int bits = pixels.depth() == CV_16U ? 16 : 8;
  if (pixels.channels() == 1 && encodings::isBayer(source) && encodings::bitDepth(source) == bits) {
    return source;
  }
  const char* const name = pixels.channels() == 1   ? "mono"
                           : pixels.channels() == 3 ? "bgr"
                                                    : "bgra";
  return name + std::to_string(bits);
}

}  // namespace

RawImage fromMsg(const sensor_msgs::Image& image) {
  return {image.height, image.width,       image.encoding,   image.is_bigendian != 0,
          image.step,   image.data.data(), image.data.size()};
}

CameraInfo fromMsg(const sensor_msgs::CameraInfo& msg) {
  CameraInfo info;
  info.height = msg.height;
  info.width = msg.width;
  info.distortion_model = msg.distortion_model;
  info.D = msg.D;
  std::copy(msg.K.begin(), msg.K.end(), info.K.begin());
  std::copy(msg.R.begin(), msg.R.end(), info.R.begin());
  std::copy(msg.P.begin(), msg.P.end(), info.P.begin());
  info.binning_x = msg.binning_x;
  info.binning_y = msg.binning_y;
  info.roi = {msg.roi.x_offset, msg.roi.y_offset, msg.roi.height, msg.roi.width};
  return info;
}

sensor_msgs::ImagePtr toMsg(const cv::Mat& pixels, const std::string& encoding,
                            const std_msgs::Header& header) {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->header = header;
  image->height = static_cast<std::uint32_t>(pixels.rows);
  image->width = static_cast<std::uint32_t>(pixels.cols);
  image->encoding = encoding;
  image->step = static_cast<std::uint32_t>(pixels.cols * pixels.elemSize());
  image->data.assign(pixels.datastart, pixels.dataend);
  return image;
}

sensor_msgs::ImagePtr decode(const sensor_msgs::CompressedImage& image) {
  const std::string_view bytes(reinterpret_cast<const char*>(image.data.data()), image.data.size());
  try {
    const cv::Mat pixels = decodePixels(bytes);
    return toMsg(pixels, encodingOf(pixels, image.format), image.header);
  } catch (const DataError& error) {
    throw DataError("the compressed image (format \"" + image.format + "\", " +
                    std::to_string(bytes.size()) + " bytes) " + error.what());
  }
}

sensor_msgs::CameraInfo toCameraInfo(const CameraCalibration& c) {
  sensor_msgs::CameraInfo info;
  info.width = static_cast<std::uint32_t>(c.width);
  info.height = static_cast<std::uint32_t>(c.height);
  info.distortion_model = sensor_msgs::distortion_models::PLUMB_BOB;
  info.D = c.distortion;
  info.D.resize(5);
  info.K = {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0};
  return info;
}

sensor_msgs::CameraInfo toCameraInfo(const PinholeCamera& camera) {
  return toCameraInfo(calibrationOf(camera));
}

}  // namespace ground_scale_vo
