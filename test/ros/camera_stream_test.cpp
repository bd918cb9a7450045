#include "ground_scale_vo/ros/camera_stream.hpp"

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

TEST(CameraStream, AnotherCameraOnlyWhenTheCalibrationChanges) {
  CameraStream stream(false);
  EXPECT_EQ(stream.camera(), nullptr);
  stream.accept(info(), "t");
  const auto first = stream.camera();
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->camera().fx, 10);
  stream.accept(info(), "t");
  EXPECT_EQ(stream.camera(), first);
  sensor_msgs::CameraInfo other = info();
  other.K[0] = 11;
  stream.accept(other, "t");
  EXPECT_NE(stream.camera(), first);
  EXPECT_EQ(stream.camera()->camera().fx, 11);
}

TEST(CameraStream, KeepsItsCameraWhenOneIsRefused) {
  CameraStream stream(false);
  stream.accept(info(), "t");
  const auto first = stream.camera();
  EXPECT_THROW(stream.accept(sensor_msgs::CameraInfo(), "t"), MessageError);
  EXPECT_EQ(stream.camera(), first);
}

TEST(CalibratedCamera, RectifiesImagesOfItsSizeOnly) {
  CameraStream stream(false);
  stream.accept(info(), "t");
  const sensor_msgs::Image msg = image(8, 6);
  GreyConverter converter;
  const cv::Mat grey = stream.camera()->rectified(msg, &converter);
  EXPECT_EQ(grey.type(), CV_8UC1);
  EXPECT_EQ(grey.at<std::uint8_t>(3, 3), 100);
  try {
    stream.camera()->rectified(image(6, 8), &converter);
    FAIL() << "took it";
  } catch (const MessageError& error) {
    EXPECT_STREQ(error.what(), "the image is 6 x 8, camera_info says 8 x 6");
  }
}

TEST(CalibratedCamera, TellsAnotherCameraFromItsOwn) {
  CameraStream stream(false);
  stream.accept(info(), "t");
  PinholeCamera camera = stream.camera()->camera();
  camera.cx += 1e-6;  // was a float once
  EXPECT_TRUE(stream.camera()->isCameraOf(camera));
  camera.fx += 0.1;
  EXPECT_FALSE(stream.camera()->isCameraOf(camera));
  camera = stream.camera()->camera();
  camera.width = 9;
  EXPECT_FALSE(stream.camera()->isCameraOf(camera));
}

}  // namespace
}  // namespace ground_scale_vo
