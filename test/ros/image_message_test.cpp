#include "ground_scale_vo/ros/image_message.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

sensor_msgs::CompressedImage encoded(const std::string& format, const std::string& extension,
                                     int type = CV_8UC1) {
  sensor_msgs::CompressedImage image;
  image.header.stamp = ros::Time(3, 4);
  image.header.frame_id = "camera";
  image.format = format;
  cv::imencode(extension, cv::Mat(6, 8, type, cv::Scalar::all(90)), image.data);
  return image;
}

TEST(CompressedImage, DecodesEveryKindOfPixel) {
  const struct {
    const char *format, *extension;
    int type;
    const char* encoding;
  } kKinds[] = {{"mono8; jpeg compressed ", ".jpg", CV_8UC1, "mono8"},
                {"rgb8; jpeg compressed bgr8", ".jpg", CV_8UC3, "bgr8"},
                {"jpeg", ".jpg", CV_8UC3, "bgr8"},
                {"", ".png", CV_8UC4, "bgra8"},
                {"mono16; png compressed ", ".png", CV_16UC1, "mono16"},
                {"rgb16; png compressed ", ".png", CV_16UC3, "bgr16"},
                {"bayer_rggb8; jpeg compressed ", ".jpg", CV_8UC1, "bayer_rggb8"},
                {"bayer_grbg16; png compressed ", ".png", CV_16UC1, "bayer_grbg16"},
                {"bayer_rggb16; jpeg compressed ", ".jpg", CV_8UC1, "mono8"},
                {"bayer_rggb8; jpeg compressed bgr8", ".jpg", CV_8UC3, "bgr8"}};
  for (const auto& kind : kKinds) {
    const auto image = decode(encoded(kind.format, kind.extension, kind.type));
    EXPECT_EQ(image->encoding, kind.encoding) << kind.format;
    EXPECT_EQ(image->width, 8u);
    EXPECT_EQ(image->height, 6u);
    EXPECT_EQ(image->data.size(), 6u * 8 * CV_ELEM_SIZE(kind.type)) << kind.format;
    EXPECT_NEAR(image->data[0], 90, 1);
    EXPECT_EQ(image->header.stamp, ros::Time(3, 4));
    EXPECT_EQ(image->header.frame_id, "camera");
  }
}

TEST(CompressedImage, RefusesWhatCannotBeDecoded) {
  const sensor_msgs::CompressedImage good = encoded("mono8; jpeg compressed ", ".jpg");
  sensor_msgs::CompressedImage empty = good, truncated = good, damaged = good;
  empty.data.clear();
  truncated.data.resize(good.data.size() - 2);
  std::fill(damaged.data.begin() + 2, damaged.data.end() - 2, std::uint8_t{0});
  for (const auto& image : {empty, truncated, damaged}) EXPECT_THROW(decode(image), DataError);
}

}  // namespace
}  // namespace ground_scale_vo
