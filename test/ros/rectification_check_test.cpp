#include "ground_scale_vo/ros/rectification_check.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "ground_scale_vo/ros/calibrated_camera.hpp"

namespace ground_scale_vo {
namespace {

std::string contradiction(const sensor_msgs::CameraInfo& info, bool image_is_rectified,
                          const std::string& image_topic) {
  return rectificationContradiction(info, image_is_rectified, image_topic).reason;
}

/// A raw camera as camera_calibration describes it. alpha: 0 crops the rectified image, 1 keeps all
/// raw pixels.
sensor_msgs::CameraInfo rawCamera(const std::vector<double>& D, double alpha) {
  PinholeCamera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 400;
  camera.cx = 320;
  camera.cy = 240;
  sensor_msgs::CameraInfo info = toCameraInfo(camera);
  info.D = D;
  const cv::Matx33d P =
      cv::getOptimalNewCameraMatrix(cv::Matx33d(info.K.data()), D, cv::Size(640, 480), alpha);
  info.P[0] = P(0, 0);
  info.P[5] = P(1, 1);
  info.P[2] = P(0, 2);
  info.P[6] = P(1, 2);
  return info;
}

/// camera_info of kitti2bag for a raw drive: K and D of the raw camera of 1392 x 512, size and P of
/// the rectified images.
sensor_msgs::CameraInfo kittiRaw() {
  sensor_msgs::CameraInfo info;
  info.width = 1242;
  info.height = 375;
  info.distortion_model = "plumb_bob";
  info.D = {-0.3728755, 0.2037299, 0.002219027, 0.001383707, -0.07233722};
  info.K = {984.2439, 0, 690, 0, 980.8141, 233.1966, 0, 0, 1};
  info.R = {0.9999239,    0.00983776,  -0.007445048, -0.009869795, 0.9999421,
            -0.004278459, 0.007402527, 0.004351614,  0.9999631};
  info.P = {721.5377, 0, 609.5593, 0, 0, 721.5377, 172.854, 0, 0, 0, 1, 0};
  return info;
}

const std::vector<double> kBarrel{-0.3, 0.1, 0, 0, 0};

TEST(RectificationCheck, AcceptsRawImagesOfCalibratedCameras) {
  for (const double alpha : {0.0, 0.5, 1.0}) {
    EXPECT_EQ(contradiction(rawCamera(kBarrel, alpha), false, "/cam/image_raw"), "");
    EXPECT_EQ(contradiction(rawCamera({0.1, 0, 0, 0, 0}, alpha), false, "/image"), "");
    EXPECT_EQ(contradiction(rawCamera({0, 0, 0, 0, 0}, alpha), false, "/image"), "");
  }
  sensor_msgs::CameraInfo fisheye = rawCamera({0, 0, 0, 0, 0}, 0);
  fisheye.distortion_model = "equidistant";
  fisheye.D = {0.01, 0, 0, 0};
  EXPECT_EQ(contradiction(fisheye, false, "/image_raw"), "");
}

TEST(RectificationCheck, AcceptsRectifiedImages) {
  for (const bool flag : {false, true}) {
    EXPECT_EQ(contradiction(rawCamera({0, 0, 0, 0, 0}, 0), flag, "/cam/image_rect"), "");
  }
  EXPECT_EQ(contradiction(rawCamera(kBarrel, 0), true, "/cam/image_rect"), "");
  EXPECT_EQ(contradiction(kittiRaw(), true, "/kitti/camera_gray_left/image_raw"), "");
  sensor_msgs::CameraInfo only_P = kittiRaw();
  only_P.K.fill(0);
  EXPECT_EQ(contradiction(only_P, false, "/kitti/camera_gray_left/image_rect"), "");
}

TEST(RectificationCheck, FindsRectifiedImagesThatAreTakenForRaw) {
  EXPECT_EQ(contradiction(kittiRaw(), false, "/kitti/camera_gray_left/image_raw"),
            "P of camera_info (fx 721.538) cannot describe images of 1242 x 375 that are rectified "
            "with K (fx 984.244) and D");
  EXPECT_NE(contradiction(rawCamera(kBarrel, 0), false, "/cam/image_rect_color"), "");
  sensor_msgs::CameraInfo other_P = rawCamera({0, 0, 0, 0, 0}, 0);
  other_P.P[0] = other_P.P[5] = 300;
  EXPECT_NE(contradiction(other_P, false, "/image"), "");
  other_P.P[0] = other_P.P[5] = 600;
  EXPECT_NE(contradiction(other_P, false, "/image"), "");
}

TEST(RectificationCheck, FindsRawImagesThatAreTakenForRectified) {
  for (const std::string topic : {"/cam/image_raw", "/cam/image_raw/compressed"}) {
    EXPECT_NE(contradiction(rawCamera(kBarrel, 0), true, topic), "");
  }
  sensor_msgs::CameraInfo same_P = rawCamera({0, 0, 0, 0, 0}, 0);
  same_P.P = toCameraInfo(CalibratedCamera(same_P, "t", false).camera()).P;
  same_P.D = kBarrel;
  EXPECT_NE(contradiction(same_P, true, "/image"), "");
}

TEST(RectificationCheck, TheNamespaceOfTheTopicSaysNothingAboutTheImages) {
  EXPECT_EQ(contradiction(rawCamera(kBarrel, 0), false, "/robot/rectangle/image_raw"), "");
  EXPECT_EQ(contradiction(rawCamera(kBarrel, 0), true, "/robot/raw/image_rect/compressed"), "");
}

// The rectified images of a stereo camera may keep the principal point of the raw ones.
TEST(RectificationCheck, AcceptsRectifiedImagesWithThePrincipalPointOfK) {
  sensor_msgs::CameraInfo info = rawCamera(kBarrel, 0);
  info.P[2] = info.K[2];
  info.P[6] = info.K[5];
  ASSERT_NE(info.P[0], info.K[0]);
  EXPECT_EQ(contradiction(info, true, "/image"), "");
}

TEST(RectificationCheck, AcceptsRectifiedImagesWithTheFocalLengthOfK) {
  for (const std::size_t centre : {2, 6}) {
    sensor_msgs::CameraInfo info = rawCamera(kBarrel, 0);
    info.P = {info.K[0], 0, info.K[2], 0, 0, info.K[4], info.K[5], 0, 0, 0, 1, 0};
    EXPECT_NE(contradiction(info, true, "/image"), "");
    info.P[centre] += 10;
    EXPECT_EQ(contradiction(info, true, "/image"), "") << centre;
  }
}

// The camera of a stereo pair that looks 20 degrees to the side of the rectified images, whose
// principal point is moved so that they show the same part of the scene.
TEST(RectificationCheck, AcceptsTheRotationOfAStereoCalibration) {
  const double angle = 20 * M_PI / 180;
  sensor_msgs::CameraInfo info = rawCamera({0, 0, 0, 0, 0}, 0);
  info.R = {std::cos(angle), 0, std::sin(angle), 0, 1, 0, -std::sin(angle), 0, std::cos(angle)};
  info.P[2] = info.K[2] - info.K[0] * std::tan(angle);
  EXPECT_EQ(contradiction(info, false, "/image"), "");
  info.P[2] = info.K[2] + info.K[0] * std::tan(angle);
  EXPECT_NE(contradiction(info, false, "/image"), "") << "to the other side";
}

TEST(RectificationCheck, OnlyAnImpossiblePIsCertain) {
  const auto is_certain = [](const sensor_msgs::CameraInfo& info, bool image_is_rectified,
                             const std::string& topic) {
    return rectificationContradiction(info, image_is_rectified, topic).is_certain;
  };
  EXPECT_TRUE(is_certain(kittiRaw(), false, "/kitti/camera_gray_left/image_raw"));
  EXPECT_TRUE(is_certain(kittiRaw(), false, "/kitti/camera_gray_left/image_rect"));
  EXPECT_FALSE(is_certain(rawCamera(kBarrel, 0), false, "/cam/image_rect"));
  EXPECT_FALSE(is_certain(rawCamera(kBarrel, 0), true, "/cam/image_raw"));
  sensor_msgs::CameraInfo same_P = rawCamera({0, 0, 0, 0, 0}, 0);
  same_P.P = toCameraInfo(CalibratedCamera(same_P, "t", false).camera()).P;
  same_P.D = kBarrel;
  EXPECT_FALSE(is_certain(same_P, true, "/image"));
  sensor_msgs::CameraInfo centre = rawCamera({0, 0, 0, 0, 0}, 0);
  centre.distortion_model = "equidistant";
  centre.D = {0.01, 0, 0, 0};
  centre.P[0] = centre.P[5] = 3 * centre.K[0];
  EXPECT_NE(contradiction(centre, false, "/image_raw"), "");
  EXPECT_FALSE(is_certain(centre, false, "/image_raw")) << "the centre of a fisheye image";
}

// They are dropped by CalibratedCamera, or compared as well as possible.
TEST(RectificationCheck, InvalidMatricesAreNoContradiction) {
  sensor_msgs::CameraInfo info = rawCamera(kBarrel, 0);
  info.P[0] = -1;
  EXPECT_EQ(contradiction(info, false, "/image"), "");
  info = rawCamera(kBarrel, 0);
  info.R.fill(7);
  EXPECT_EQ(contradiction(info, false, "/image"), "");
  EXPECT_EQ(contradiction(sensor_msgs::CameraInfo(), true, "/image"), "");
}

}  // namespace
}  // namespace ground_scale_vo
