#include "ros/image_input.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "support/expect_throws.hpp"
#include "support/temporary_folder.hpp"

namespace gsv {
namespace {

sensor_msgs::CameraInfo infoOf(double fx, double k1 = 0) {
  sensor_msgs::CameraInfo info = toCameraInfo(PinholeCamera{8, 6, fx, 10, 4, 3});
  info.D[0] = k1;
  return info;
}

cv::Mat uniformImage(int width, int height) { return {height, width, CV_8UC1, cv::Scalar(100)}; }

TEST(CameraInput, ReplacesItsCameraOnlyForAnotherValidCalibration) {
  for (const double k1 : {0.0, -0.2}) {
    const sensor_msgs::CameraInfo original = infoOf(10, k1);
    CameraInput input(false);
    EXPECT_EQ(input.camera(), nullptr);
    input.setCameraInfo(original, "t");
    const auto first = input.camera();
    ASSERT_NE(first, nullptr);
    EXPECT_THROW(input.setCameraInfo(sensor_msgs::CameraInfo(), "t"), DataError);
    EXPECT_EQ(input.camera(), first);
    // A calibration on line varies by less than a tenth of a pixel.
    sensor_msgs::CameraInfo other;
    for (const std::size_t i : {0, 2, 4, 5}) {
      other = original;
      other.K[i] += 0.05;
      input.setCameraInfo(other, "t");
      EXPECT_EQ(input.camera(), first) << i;
    }
    other = original;
    other.D[0] += 1e-3;
    input.setCameraInfo(other, "t");
    EXPECT_EQ(input.camera(), first);
    other.D[0] += 0.2;
    input.setCameraInfo(other, "t");
    EXPECT_NE(input.camera(), first);
    input.setCameraInfo(infoOf(11, k1), "t");
    EXPECT_EQ(input.camera()->fx, 11);
  }
}

using CameraFile = TemporaryFolder;

TEST_F(CameraFile, ThatCannotBeUsedIsRefused) {
  const CameraCalibration wide{8, 6, 1e-3, 10, 4, 3, {}};
  const std::string file = write("camera.yaml", cameraYaml(wide, ""));
  expectThrows<OptionError>([&] { CameraInput(false, "", file); },
                            "parameter camera_file: " + file + " cannot be used: ");
  expectThrows<OptionError>([&] { CameraInput(false, "", file + "l"); },
                            "parameter camera_file: " + file + "l: no such file");
  const CameraCalibration camera{8, 6, 10, 10, 4, 3, {}};
  write("camera.yaml", cameraYaml(camera, ""));
  expectThrows<DataError>([&] { CameraInput(false, "", file).grey(uniformImage(6, 8)); },
                          "but parameter camera_file: " + file + " describes 8x6");
}

class MaskFile : public TemporaryFolder {
 protected:
  std::string writeMask(int width, int height) const {
    const std::string file = folder_ / "mask.png";
    EXPECT_TRUE(cv::imwrite(file, cv::Mat(height, width, CV_8UC1, cv::Scalar(255))));
    return file;
  }
};

TEST_F(MaskFile, HasTheSizeOfThePublishedImages) {
  const std::string file = writeMask(3, 2);
  CameraInput input(false, file);
  expectThrows<DataError>(
      [&] { input.setCameraInfo(infoOf(10), "/info"); },
      "parameter mask: " + file + " is 3x2, the camera 8x6 of camera_info on topic /info");
  const CameraCalibration calibration{8, 6, 10, 10, 4, 3, {}};
  const std::string camera = write("camera.yaml", cameraYaml(calibration, ""));
  expectThrows<OptionError>([&] { CameraInput(false, file, camera); },
                            file + " is 3x2, the camera 8x6 of parameter camera_file: " + camera);
  EXPECT_EQ(input.camera(), nullptr);
  sensor_msgs::CameraInfo cropped = infoOf(10);
  cropped.roi.x_offset = 2;
  cropped.roi.width = 6;
  cropped.roi.height = 4;
  cropped.binning_x = cropped.binning_y = 2;
  EXPECT_NO_THROW(input.setCameraInfo(cropped, "t"));
  EXPECT_EQ(input.grey(uniformImage(3, 2)).size(), cv::Size(3, 2));
}

TEST_F(MaskFile, ThatCannotBeReadIsRefused) {
  const std::string truncated = writeMask(80, 60);
  std::filesystem::resize_file(truncated, std::filesystem::file_size(truncated) - 40);
  expectThrows<OptionError>([&] { CameraInput(false, truncated); },
                            "parameter mask: " + truncated + ": is not a whole PNG or JPEG image");
}

using Guard = SourceGuard<std::string>;

TEST(SourceGuard, TheFirstOfTwoAlternatingSourcesStaysInUseUntilOneEnds) {
  for (const int ratio : {2, 50}) {
    for (const std::string left : {"a", "b"}) {
      Guard guard;
      for (const char* source : {"a", "b", "a"}) guard.accepts(source);
      EXPECT_FALSE(guard.refused());
      for (int i = 0; i < 1000; ++i) {
        const bool is_second = i % ratio == 0;
        EXPECT_EQ(guard.accepts(is_second ? "b" : "a"), !is_second);
        EXPECT_EQ(guard.refused(), "b");
      }
      for (int i = 0; i < Guard::kMemory; ++i) guard.accepts(left);
      EXPECT_FALSE(guard.refused());
      EXPECT_EQ(guard.current(), left);
    }
  }
}

}  // namespace
}  // namespace gsv
