#include "ground_scale_vo/ros/image_rectifier.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

sensor_msgs::CameraInfo infoOf(double fx, double k1 = 0) {
  sensor_msgs::CameraInfo info = toCameraInfo({8, 6, fx, 10, 4, 3});
  info.D[0] = k1;
  return info;
}

sensor_msgs::Image uniformImage(std::uint32_t width, std::uint32_t height) {
  sensor_msgs::Image image;
  image.encoding = "mono8";
  image.width = image.step = width;
  image.height = height;
  image.data.assign(width * height, 100);
  return image;
}

/// The message of the error that the action throws; empty: none.
template <typename Error>
std::string messageOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(ImageRectifier, ReplacesItsCameraOnlyForAnotherValidCalibration) {
  ImageRectifier rectifier(false);
  EXPECT_EQ(rectifier.camera(), nullptr);
  rectifier.setCameraInfo(infoOf(10), "t");
  const auto first = rectifier.camera();
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->camera().fx, 10);
  rectifier.setCameraInfo(infoOf(10), "t");
  EXPECT_EQ(rectifier.camera(), first);
  EXPECT_THROW(rectifier.setCameraInfo(sensor_msgs::CameraInfo(), "t"), MessageError);
  EXPECT_EQ(rectifier.camera(), first);
  rectifier.setCameraInfo(infoOf(11), "t");
  EXPECT_NE(rectifier.camera(), first);
  EXPECT_EQ(rectifier.camera()->camera().fx, 11);
}

TEST(ImageRectifier, KeepsItsCameraWhileItVariesByLessThanATenthOfAPixel) {
  for (const double k1 : {0.0, -0.2}) {
    const sensor_msgs::CameraInfo original = infoOf(10, k1);
    ImageRectifier rectifier(false);
    rectifier.setCameraInfo(original, "t");
    const auto first = rectifier.camera();
    sensor_msgs::CameraInfo nearly = original;
    for (const std::size_t i : {0, 2, 4, 5}) {
      nearly = original;
      nearly.K[i] += 0.05;
      rectifier.setCameraInfo(nearly, "t");
      EXPECT_EQ(rectifier.camera(), first) << i;
    }
    nearly = original;
    nearly.D[0] += 1e-3;
    rectifier.setCameraInfo(nearly, "t");
    EXPECT_EQ(rectifier.camera(), first);
    nearly.D[0] += 0.2;
    rectifier.setCameraInfo(nearly, "t");
    EXPECT_NE(rectifier.camera(), first);
  }
}

TEST(CalibratedCamera, MatchesTheSameIntrinsicsUpToRounding) {
  const CalibratedCamera calibrated(infoOf(10), "t", false);
  EXPECT_TRUE(calibrated.matches({8, 6, 10, 10, 4 + 1e-6, 3}));  // after a conversion to float
  const PinholeCamera kOthers[] = {{9, 6, 10, 10, 4, 3},   {8, 7, 10, 10, 4, 3},
                                   {8, 6, 10.2, 10, 4, 3}, {8, 6, 10, 10.2, 4, 3},
                                   {8, 6, 10, 10, 4.2, 3}, {8, 6, 10, 10, 4, 3.2}};
  for (const PinholeCamera& other : kOthers) EXPECT_FALSE(calibrated.matches(other));
}

TEST(ImageRectifier, KeepsTheFirstOfTwoCalibrationsThatAlternate) {
  ImageRectifier rectifier(false);
  for (const double fx : {10, 11, 10}) rectifier.setCameraInfo(infoOf(fx), "t");
  const auto first = rectifier.camera();
  EXPECT_EQ(first->camera().fx, 10);
  for (int i = 0; i < 3; ++i) {
    const std::string message =
        messageOf<MessageError>([&] { rectifier.setCameraInfo(infoOf(11), "t"); });
    for (const char* part : {"two cameras publish on t", "fx 10, ", "fx 11, ", "no distortion"}) {
      EXPECT_NE(message.find(part), std::string::npos) << message;
    }
    EXPECT_TRUE(rectifier.calibrationAlternates());
    rectifier.setCameraInfo(infoOf(10), "t");
    EXPECT_EQ(rectifier.camera(), first);
  }
}

TEST(ImageRectifier, RefusesImagesOfAnotherSize) {
  ImageRectifier rectifier(false);
  rectifier.setCameraInfo(infoOf(10), "t");
  const sensor_msgs::Image image = uniformImage(8, 6);
  EXPECT_EQ(rectifier.rectify(image).at<std::uint8_t>(3, 3), 100);
  EXPECT_THROW(rectifier.rectify(uniformImage(9, 6)), MessageError);
  EXPECT_THROW(rectifier.rectify(uniformImage(8, 5)), MessageError);
  EXPECT_EQ(messageOf<MessageError>([&] { rectifier.rectify(uniformImage(6, 8)); }),
            "the image is 6 x 8, but camera_info describes 8 x 6");
}

class MaskFile : public TemporaryFolder {
 protected:
  /// White but for its first row.
  std::string writeMask(int width, int height, const std::string& name = "mask.png",
                        int type = CV_8UC1) const {
    cv::Mat mask(height, width, type, cv::Scalar::all(255));
    mask.row(0).setTo(0);
    const std::string file = folder_ / name;
    EXPECT_TRUE(cv::imwrite(file, mask));
    return file;
  }
};

TEST_F(MaskFile, IsRectifiedWithTheImages) {
  for (const int type : {CV_8UC1, CV_8UC3}) {  // most drawing programs write it in colour
    ImageRectifier rectifier(false, writeMask(8, 6, "mask.png", type));
    EXPECT_TRUE(rectifier.mask().empty());  // no camera yet
    rectifier.setCameraInfo(infoOf(10), "t");
    const cv::Mat mask = rectifier.mask();
    ASSERT_EQ(mask.size(), cv::Size(8, 6));
    EXPECT_EQ(cv::countNonZero(mask), 8 * 5);
    EXPECT_EQ(cv::countNonZero(mask.row(0)), 0);
    rectifier.setCameraInfo(infoOf(10, 0.4), "t");
    EXPECT_LT(cv::countNonZero(rectifier.mask()), 8 * 5);
  }
}

TEST_F(MaskFile, HasTheSizeOfThePublishedImages) {
  const std::string file = writeMask(3, 2);
  ImageRectifier rectifier(false, file);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(messageOf<MessageError>([&] { rectifier.setCameraInfo(infoOf(10), "/info"); }),
              "parameter mask: " + file + " is 3x2, the camera 8x6 of camera_info on topic /info");
    EXPECT_EQ(rectifier.camera(), nullptr);
  }
  sensor_msgs::CameraInfo cropped = infoOf(10);
  cropped.roi.x_offset = 2;
  cropped.roi.width = 6;
  cropped.roi.height = 4;
  cropped.binning_x = cropped.binning_y = 2;
  EXPECT_NO_THROW(rectifier.setCameraInfo(cropped, "t"));
  EXPECT_EQ(rectifier.mask().size(), cv::Size(3, 2));
}

TEST_F(MaskFile, ThatCannotBeReadIsRefused) {
  const auto expectRefused = [](const std::string& file, const std::string& reason) {
    EXPECT_EQ(messageOf<OptionError>([&] { ImageRectifier(false, file); }),
              "parameter mask: " + file + " " + reason);
  };
  expectRefused(folder_ / "missing.png", "cannot be read");
  expectRefused(folder_, "cannot be read");
  expectRefused(write("text.png", "no image"), "is not a whole PNG or JPEG image");
  const std::string file = writeMask(80, 60);
  EXPECT_NO_THROW(ImageRectifier(false, file));
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - 40);
  expectRefused(file, "is not a whole PNG or JPEG image");
}

}  // namespace
}  // namespace ground_scale_vo
