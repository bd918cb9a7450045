#include "ground_scale_vo/input/camera_file.hpp"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/calibrated_camera.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

using CameraFile = TemporaryFolder;

const CameraCalibration kCamera{640, 480, 500.5, 501, 320.25, 240, {-0.3, 0.1, 1e-3, -2e-3, 0.01}};

TEST_F(CameraFile, ReadsWhatItWrites) {
  const auto file = write("camera.yaml", cameraYaml(kCamera, "two\nlines"));
  const CameraCalibration read = readCameraFile(file);
  EXPECT_EQ(read.width, 640);
  EXPECT_EQ(read.height, 480);
  EXPECT_EQ(read.fx, 500.5);
  EXPECT_EQ(read.fy, 501);
  EXPECT_EQ(read.cx, 320.25);
  EXPECT_EQ(read.cy, 240);
  EXPECT_EQ(read.distortion, kCamera.distortion);
  EXPECT_FALSE(read.estimated);
  EXPECT_EQ(read.readout_time, 0);
  CameraCalibration estimated = kCamera;
  estimated.estimated = true;
  estimated.readout_time = 0.0213;
  std::string text = cameraYaml(estimated, "");
  text.replace(text.find("plumb_bob"), 9, "\"plumb_bob\"");
  EXPECT_TRUE(readCameraFile(write("camera.yaml", text)).estimated);
  EXPECT_EQ(readCameraFile(write("camera.yaml", text)).readout_time, 0.0213);
}

TEST_F(CameraFile, RefusesWhatIsNotACamera) {
  EXPECT_THROW(readCameraFile(folder_ / "none.yaml"), DataError);
  const std::string good = cameraYaml(kCamera, "") + "readout_time: 0.03\n";
  for (const auto& [part, other] :
       std::vector<std::pair<std::string, std::string>>{{"plumb_bob", "omni"},
                                                        {"image_width: 640", "image_width: -1"},
                                                        {"[500.5", "[nan"},
                                                        {"0.03", "0.21"},
                                                        {"camera_matrix", "matrix"},
                                                        {", 0.01000000]", "]"}}) {
    std::string text = good;
    text.replace(text.find(part), part.size(), other);
    EXPECT_THROW(readCameraFile(write("camera.yaml", text)), DataError) << other;
  }
}

TEST(Undistortion, KeepsImagesWithoutDistortionAndMasksTheBorder) {
  CameraCalibration camera = kCamera;
  camera.distortion.assign(5, 0.0);
  const cv::Mat image(480, 640, CV_8U, cv::Scalar(7));
  EXPECT_EQ(Undistortion(camera).image(image).data, image.data);
  EXPECT_TRUE(Undistortion(camera).mask().empty());
  camera.distortion[0] = 0.05;  // pincushion: the corners come from outside
  const Undistortion undistortion(camera);
  EXPECT_EQ(undistortion.mask().at<uchar>(0, 0), 0);
  EXPECT_EQ(undistortion.mask().at<uchar>(240, 320), 255);
  EXPECT_EQ(undistortion.image(image).at<uchar>(240, 320), 7);
  EXPECT_THROW(undistortion.image(image.rowRange(0, 100)), DataError);
}

}  // namespace
}  // namespace ground_scale_vo
