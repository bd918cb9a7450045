#include "ground_scale_vo/ros/image_rectifier.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>

#include "support/jpeg_to_be_turned.hpp"
#include "support/temporary_folder.hpp"

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
  for (const auto& [width, height] : {std::pair(9, 6), {7, 6}, {8, 7}, {8, 5}}) {
    const sensor_msgs::Image other =
        image(static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height));
    EXPECT_THROW(rectifier.rectify(other), MessageError) << width << " x " << height;
  }
  try {
    rectifier.rectify(image(6, 8));
    FAIL() << "accepted";
  } catch (const MessageError& error) {
    EXPECT_STREQ(error.what(), "the image is 6 x 8, but camera_info describes 8 x 6");
  }
}

class MaskFile : public TemporaryFolder {
 protected:
  std::string writeMask(int width, int height, const std::string& name = "mask.png") const {
    cv::Mat mask(height, width, CV_8UC1, cv::Scalar(255));
    mask.row(0).setTo(0);
    const std::string file = folder_ / name;
    EXPECT_TRUE(cv::imwrite(file, mask));
    return file;
  }
};

TEST_F(MaskFile, IsRectifiedWithTheImages) {
  ImageRectifier rectifier(false, writeMask(8, 6));
  EXPECT_TRUE(rectifier.mask().empty());  // no camera yet
  rectifier.setCameraInfo(info(), "t");
  const cv::Mat mask = rectifier.mask();
  ASSERT_EQ(mask.size(), cv::Size(8, 6));
  EXPECT_EQ(cv::countNonZero(mask), 8 * 5);
  EXPECT_EQ(cv::countNonZero(mask.row(0)), 0);
  sensor_msgs::CameraInfo distorted = info();
  distorted.D[0] = 0.4;
  rectifier.setCameraInfo(distorted, "t");
  EXPECT_LT(cv::countNonZero(rectifier.mask()), 8 * 5);
  rectifier.setCameraInfo(distorted, "t");
  EXPECT_FALSE(ImageRectifier(false).mask().data);
}

// As most drawing programs write it.
TEST_F(MaskFile, MayBeInColour) {
  cv::Mat mask(6, 8, CV_8UC3, cv::Scalar::all(255));
  mask.row(0).setTo(0);
  const std::string file = folder_ / "colour.png";
  ASSERT_TRUE(cv::imwrite(file, mask));
  ImageRectifier rectifier(false, file);
  rectifier.setCameraInfo(info(), "t");
  EXPECT_EQ(cv::countNonZero(rectifier.mask()), 8 * 5);
}

// As the images, which have the orientation of the sensor.
TEST_F(MaskFile, IsNotTurnedByItsOrientation) {
  const cv::Mat mask(6, 8, CV_8UC1, cv::Scalar(255));
  ImageRectifier rectifier(false, write("turned.jpg", jpegToBeTurned(mask)));
  EXPECT_NO_THROW(rectifier.setCameraInfo(info(), "t"));
}

TEST_F(MaskFile, OfAnotherSizeThanTheImagesIsRefusedWithEachCameraInfo) {
  const std::string file = writeMask(6, 8);
  ImageRectifier rectifier(false, file);
  for (int i = 0; i < 2; ++i) {
    try {
      rectifier.setCameraInfo(info(), "/cam/info");
      FAIL() << "accepted";
    } catch (const MessageError& error) {
      EXPECT_EQ(error.what(), "parameter mask: " + file +
                                  " is 6x8, the camera 8x6 of camera_info on topic /cam/info");
    }
    EXPECT_EQ(rectifier.camera(), nullptr);
  }
}

// With binning and a region of interest the images that are published count.
TEST_F(MaskFile, HasTheSizeOfThePublishedImages) {
  sensor_msgs::CameraInfo cropped = info();
  cropped.roi.x_offset = 2;
  cropped.roi.width = 6;
  cropped.roi.height = 4;
  cropped.binning_x = cropped.binning_y = 2;
  ImageRectifier rectifier(false, writeMask(3, 2));
  EXPECT_NO_THROW(rectifier.setCameraInfo(cropped, "t"));
  EXPECT_EQ(rectifier.mask().size(), cv::Size(3, 2));
}

TEST_F(MaskFile, ThatCannotBeReadIsRefused) {
  const auto refusal = [](const std::string& file) -> std::string {
    try {
      ImageRectifier(false, file);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "";
  };
  const std::string missing = folder_ / "missing.png";
  EXPECT_EQ(refusal(missing), "parameter mask: " + missing + " cannot be read");
  const std::string folder = folder_;
  EXPECT_EQ(refusal(folder), "parameter mask: " + folder + " cannot be read");
  const std::string text = write("text.png", "no image");
  EXPECT_EQ(refusal(text), "parameter mask: " + text + " is not a whole PNG or JPEG image");
  // Signature, header of 60000 x 60000 px, end mark.
  const std::string header(
      "\x89PNG\r\n\x1a\n"
      "\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x08\0\0\0\0\0\0\0\0"
      "\0\0\0\0IEND\xae\x42\x60\x82",
      45);
  const std::string huge = write("huge.png", header);
  EXPECT_EQ(refusal(huge),
            "parameter mask: " + huge + " states 60000 x 60000 pixels, more than are plausible");
  for (const char* name : {"truncated.png", "truncated.jpg"}) {
    const std::string file = writeMask(80, 60, name);
    EXPECT_EQ(refusal(file), "");
    std::filesystem::resize_file(file, std::filesystem::file_size(file) - 40);
    EXPECT_EQ(refusal(file), "parameter mask: " + file + " is not a whole PNG or JPEG image");
  }
}

TEST(CalibratedCamera, MatchesTheSameIntrinsicsUpToRounding) {
  ImageRectifier rectifier(false);
  rectifier.setCameraInfo(info(), "t");
  PinholeCamera camera = rectifier.camera()->camera();
  camera.cx += 1e-6;  // as after a conversion to float
  EXPECT_TRUE(rectifier.camera()->matches(camera));
  for (double PinholeCamera::*const parameter :
       {&PinholeCamera::fx, &PinholeCamera::fy, &PinholeCamera::cx, &PinholeCamera::cy}) {
    camera = rectifier.camera()->camera();
    camera.*parameter += 0.2;
    EXPECT_FALSE(rectifier.camera()->matches(camera));
  }
  for (int PinholeCamera::*const size : {&PinholeCamera::width, &PinholeCamera::height}) {
    camera = rectifier.camera()->camera();
    camera.*size += 1;
    EXPECT_FALSE(rectifier.camera()->matches(camera));
  }
}

}  // namespace
}  // namespace ground_scale_vo
