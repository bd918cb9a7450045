#include "input/camera_input.hpp"

#include "support/camera_info.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

CameraInfo infoOf(double fx, double k1 = 0) {
  CameraInfo info = cameraInfo({8, 6, fx, 10, 4, 3});
  info.D[0] = k1;
  return info;
}

cv::Mat uniformImage(int width, int height) { return {height, width, CV_8UC1, cv::Scalar(100)}; }

TEST(CameraInput, ReplacesItsCameraOnlyForAnotherValidCalibration) {
  for (const double k1 : {0.0, -0.2}) {
    CameraInput input(false);
    EXPECT_EQ(input.camera(), nullptr);
    input.setCameraInfo(infoOf(10, k1), "t");
    const auto first = input.camera();
    ASSERT_NE(first, nullptr);
    EXPECT_THROW(input.setCameraInfo(CameraInfo(), "t"), DataError);
    // A calibration on line varies by less than a tenth of a pixel.
    for (const std::size_t i : {0, 2, 4, 5}) {
      CameraInfo other = infoOf(10, k1);
      other.K[i] += 0.05;
      input.setCameraInfo(other, "t");
      EXPECT_EQ(input.camera(), first) << i;
    }
    input.setCameraInfo(infoOf(10, k1 + 1e-3), "t");
    EXPECT_EQ(input.camera(), first);
    input.setCameraInfo(infoOf(10, k1 + 0.2), "t");
    EXPECT_NE(input.camera(), first);
    input.setCameraInfo(infoOf(11, k1), "t");
    EXPECT_EQ(input.camera()->fx, 11);
  }
}

TEST(CameraInput, ACalibrationWithoutASizeHasThatOfTheImages) {
  CameraInfo info = infoOf(10);
  info.width = info.height = 0;
  info.K[2] = 3.5, info.K[5] = 2.5;
  CameraInput input(false);
  EXPECT_FALSE(input.isReady());
  input.setCameraInfo(info, "t");
  ASSERT_TRUE(input.isReady());
  EXPECT_EQ(input.camera(), nullptr);
  EXPECT_THROW(input.grey(uniformImage(16, 6), "mono8"), DataError) << "not centred";
  input.grey(uniformImage(8, 6), "mono8");
  const auto camera = input.camera();
  ASSERT_NE(camera, nullptr);
  EXPECT_EQ(camera->width, 8);
  EXPECT_EQ(camera->height, 6);
  input.setCameraInfo(info, "t");
  EXPECT_EQ(input.camera(), camera) << "the same once more";
  info.K[0] = 11;
  input.setCameraInfo(info, "t");
  EXPECT_EQ(input.camera()->fx, 11);
}

TEST(CameraInput, ImagesOfAnotherFrameIdAreOfAnotherCamera) {
  CameraInput input(false);
  input.setCameraInfo(infoOf(10), "t");
  const auto first = input.camera();
  EXPECT_TRUE(input.isOfCamera("a"));
  EXPECT_TRUE(input.isOfCamera("a"));
  EXPECT_EQ(input.camera(), first);
  EXPECT_TRUE(input.isOfCamera("b"));
  EXPECT_NE(input.camera(), first);
  EXPECT_TRUE(input.isOfCamera("a"));
  EXPECT_EQ(input.sourceError("/image"), "");
  EXPECT_FALSE(input.isOfCamera("b"));
  EXPECT_EQ(input.sourceError("/image"),
            "two cameras publish on /image: images with the frame_id \"a\" are used, those with "
            "\"b\" are not");
}

TEST(CameraInput, TheMaskHasTheSizeOfThePublishedImages) {
  CameraInput input(false, uniformImage(3, 2), "the mask m.png");
  expectThrows<DataError>([&] { input.setCameraInfo(infoOf(10), "/info"); },
                          "the mask m.png is 3x2, the camera 8x6 of camera_info on topic /info");
  EXPECT_EQ(input.camera(), nullptr);
  CameraInfo cropped = infoOf(10);
  cropped.roi.x_offset = 2;
  cropped.roi.width = 6;
  cropped.roi.height = 4;
  cropped.binning_x = cropped.binning_y = 2;
  EXPECT_NO_THROW(input.setCameraInfo(cropped, "t"));
  EXPECT_EQ(input.grey(uniformImage(3, 2)).size(), cv::Size(3, 2));
}

}  // namespace
}  // namespace gsv
