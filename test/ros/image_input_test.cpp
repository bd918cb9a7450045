#include "ros/image_input.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "support/expect_throws.hpp"
#include "support/temporary_folder.hpp"

namespace gsv {
namespace {

cv::Mat uniformImage(int width, int height) { return {height, width, CV_8UC1, cv::Scalar(100)}; }

using CameraFile = TemporaryFolder;

TEST_F(CameraFile, ThatCannotBeUsedIsRefused) {
  const CameraCalibration wide{8, 6, 1e-3, 10, 4, 3, {}};
  const std::string file = write("camera.yaml", cameraYaml(wide, ""));
  expectThrows<OptionError>([&] { openCameraInput(false, "", file); },
                            "parameter camera_file: " + file + " cannot be used: ");
  expectThrows<OptionError>([&] { openCameraInput(false, "", file + "l"); },
                            "parameter camera_file: " + file + "l: no such file");
  const CameraCalibration camera{8, 6, 10, 10, 4, 3, {}};
  write("camera.yaml", cameraYaml(camera, ""));
  expectThrows<DataError>([&] { openCameraInput(false, "", file)->grey(uniformImage(6, 8)); },
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
  const CameraCalibration calibration{8, 6, 10, 10, 4, 3, {}};
  const std::string camera = write("camera.yaml", cameraYaml(calibration, ""));
  expectThrows<OptionError>([&] { openCameraInput(false, file, camera); },
                            file + " is 3x2, the camera 8x6 of parameter camera_file: " + camera);
}

TEST_F(MaskFile, ThatCannotBeReadIsRefused) {
  const std::string truncated = writeMask(80, 60);
  std::filesystem::resize_file(truncated, std::filesystem::file_size(truncated) - 40);
  expectThrows<OptionError>([&] { openCameraInput(false, truncated); },
                            "parameter mask: " + truncated + ": is not a whole PNG or JPEG image");
}

}  // namespace
}  // namespace gsv
