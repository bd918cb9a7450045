#include "ground_scale_vo/ros/image_rectifier.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

sensor_msgs::CameraInfo info() {
  PinholeCamera camera;
  camera.width = 8;
  camera.height = 6;
  camera.fx = camera.fy = 10;
  camera.cx = 4;
  camera.cy = 3;
  return toCameraInfo(camera);
}

sensor_msgs::Image image(std::uint32_t width, std::uint32_t height) {
  sensor_msgs::Image image;
  image.encoding = "mono8";
  image.width = image.step = width;
  image.height = height;
  image.data.assign(width * height, 100);
  return image;
}

TEST(ImageRectifier, ReplacesItsCameraOnlyWhenTheCalibrationChanges) {
  ImageRectifier rectifier(false);
  EXPECT_EQ(rectifier.camera(), nullptr);
  rectifier.setCameraInfo(info(), "t");
  const auto first = rectifier.camera();
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->camera().fx, 10);
  rectifier.setCameraInfo(info(), "t");
  EXPECT_EQ(rectifier.camera(), first);
  sensor_msgs::CameraInfo other = info();
  other.K[0] = 11;
  rectifier.setCameraInfo(other, "t");
  EXPECT_NE(rectifier.camera(), first);
  EXPECT_EQ(rectifier.camera()->camera().fx, 11);
}

TEST(ImageRectifier, KeepsItsCameraWhileItVariesByLessThanATenthOfAPixel) {
  for (const double k1 : {0.0, -0.2}) {
    sensor_msgs::CameraInfo original = info();
    original.D[0] = k1;
    ImageRectifier rectifier(false);
    rectifier.setCameraInfo(original, "t");
    const auto first = rectifier.camera();
    for (const double difference : {1e-9, 0.05}) {
      for (const std::size_t i : {0, 2, 4, 5}) {
        sensor_msgs::CameraInfo nearly = original;
        nearly.K[i] += difference;
        rectifier.setCameraInfo(nearly, "t");
        EXPECT_EQ(rectifier.camera(), first);
      }
    }
    sensor_msgs::CameraInfo nearly = original;
    nearly.D[0] += 1e-3;
    rectifier.setCameraInfo(nearly, "t");
    EXPECT_EQ(rectifier.camera(), first);
    nearly.D[0] += 0.2;
    rectifier.setCameraInfo(nearly, "t");
    EXPECT_NE(rectifier.camera(), first);
  }
}

TEST(ImageRectifier, KeepsTheFirstOfTwoCalibrationsThatAlternate) {
  ImageRectifier rectifier(false);
  sensor_msgs::CameraInfo other = info();
  other.K[0] = 11;
  rectifier.setCameraInfo(info(), "t");
  rectifier.setCameraInfo(other, "t");
  rectifier.setCameraInfo(info(), "t");
  const auto first = rectifier.camera();
  EXPECT_EQ(first->camera().fx, 10);
  for (int i = 0; i < 3; ++i) {
    try {
      rectifier.setCameraInfo(other, "t");
      FAIL() << "accepted";
    } catch (const MessageError& error) {
      EXPECT_STREQ(
          error.what(),
          "two cameras publish on t: camera_info alternates between 8 x 6, fx 10, fy 10, cx 4, "
          "cy 3, no distortion, which is used, and 8 x 6, fx 11, fy 10, cx 4, cy 3, no "
          "distortion");
    }
    EXPECT_TRUE(rectifier.calibrationAlternates());
    rectifier.setCameraInfo(info(), "t");
    EXPECT_EQ(rectifier.camera(), first);
  }
}

TEST(ImageRectifier, KeepsItsCameraWhenACameraInfoIsRefused) {
  ImageRectifier rectifier(false);
  rectifier.setCameraInfo(info(), "t");
  const auto first = rectifier.camera();
  EXPECT_THROW(rectifier.setCameraInfo(sensor_msgs::CameraInfo(), "t"), MessageError);
  EXPECT_EQ(rectifier.camera(), first);
}

TEST(ImageRectifier, RefusesImagesOfAnotherSize) {
  ImageRectifier rectifier(false);
  rectifier.setCameraInfo(info(), "t");
  const sensor_msgs::Image msg = image(8, 6);
  const cv::Mat grey = rectifier.rectify(msg);
  EXPECT_EQ(grey.type(), CV_8UC1);
  EXPECT_EQ(grey.at<std::uint8_t>(3, 3), 100);
  try {
    rectifier.rectify(image(6, 8));
    FAIL() << "accepted";
  } catch (const MessageError& error) {
    EXPECT_STREQ(error.what(), "the image is 6 x 8, but camera_info describes 8 x 6");
  }
}

TEST(CalibratedCamera, MatchesTheSameIntrinsicsUpToRounding) {
  ImageRectifier rectifier(false);
  rectifier.setCameraInfo(info(), "t");
  PinholeCamera camera = rectifier.camera()->camera();
  camera.cx += 1e-6;  // as after a conversion to float
  EXPECT_TRUE(rectifier.camera()->matches(camera));
  camera.fx += 0.2;
  EXPECT_FALSE(rectifier.camera()->matches(camera));
  camera = rectifier.camera()->camera();
  camera.width = 9;
  EXPECT_FALSE(rectifier.camera()->matches(camera));
}

}  // namespace
}  // namespace ground_scale_vo
