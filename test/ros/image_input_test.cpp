#include "ros/image_input.hpp"

#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "ground_scale_vo/input/camera_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using CameraInputFiles = TemporaryFolder;

TEST_F(CameraInputFiles, ThatCannotBeUsedAreRefusedWithTheirParameters) {
  const std::string camera = write("camera.yaml", cameraYaml({8, 6, 10, 10, 4, 3, {}}, ""));
  const std::string wide = write("wide.yaml", cameraYaml({8, 6, 1e-3, 10, 4, 3, {}}, ""));
  const std::string small = folder_ / "small.png", truncated = folder_ / "truncated.png";
  cv::imwrite(small, cv::Mat(2, 3, CV_8UC1, cv::Scalar(255)));
  cv::imwrite(truncated, cv::Mat(60, 80, CV_8UC1, cv::Scalar(255)));
  std::filesystem::resize_file(truncated, std::filesystem::file_size(truncated) - 40);
  const struct {
    std::string mask, camera, reason;
  } kCases[] = {
      {"", wide, "parameter camera_file: " + wide + " cannot be used: "},
      {"", wide + "l", "parameter camera_file: " + wide + "l: no such file"},
      // The mask has the size of the published images.
      {small, camera, small + " is 3x2, the camera 8x6 of parameter camera_file: " + camera},
      {truncated, "", "parameter mask: " + truncated + ": is not a whole PNG or JPEG image"}};
  for (const auto& c : kCases) {
    expectThrows<OptionError>([&] { openCameraInput(false, c.mask, c.camera); }, c.reason);
  }
  const cv::Mat turned(8, 6, CV_8UC1, cv::Scalar(100));
  expectThrows<DataError>([&] { openCameraInput(false, "", camera)->grey(turned); },
                          "but parameter camera_file: " + camera + " describes 8x6");
}

}  // namespace
}  // namespace gsv
