#include "ground_scale_vo/input/camera.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "ground_scale_vo/common/error.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

TEST(Camera, ProjectInvertsRayAlsoWithTwoFocalLengths) {
  const PinholeCamera camera{640, 480, 500, 410, 320, 240};
  EXPECT_LT((camera.ray({420, 322}) - Eigen::Vector3d(0.2, 0.2, 1)).norm(), 1e-12);
  EXPECT_LT((camera.project({0.4, 0.4, 2}) - Eigen::Vector2d(420, 322)).norm(), 1e-9);
  const Eigen::Vector2d u(123.25, 45.5);
  EXPECT_LT((camera.project(7.5 * camera.ray(u)) - u).norm(), 1e-9);
}

TEST(Camera, RequiresImagesAndMasksOfItsSize) {
  const PinholeCamera camera = test::testCamera();
  EXPECT_NO_THROW(requireImage(cv::Mat(248, 800, CV_8UC1), camera));
  EXPECT_NO_THROW(requireMask({}, camera));
  EXPECT_NO_THROW(requireMask(cv::Mat(248, 800, CV_8UC1), camera));
  for (const cv::Mat& wrong : {cv::Mat(248, 801, CV_8UC1), cv::Mat(247, 800, CV_8UC1),
                               cv::Mat(248, 800, CV_8UC3), cv::Mat(800, 248, CV_8UC1)}) {
    EXPECT_THROW(requireImage(wrong, camera), OptionError) << wrong.size();
    EXPECT_THROW(requireMask(wrong, camera), OptionError) << wrong.size();
  }
  EXPECT_THROW(requireImage({}, camera), OptionError);
}

TEST(Camera, RejectsInvalidIntrinsics) {
  EXPECT_NO_THROW(test::testCamera().validate());
  PinholeCamera camera = test::testCamera();
  for (double* const number : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) {
    camera = test::testCamera();
    *number = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(camera.validate(), OptionError) << number - &camera.fx;
  }
  camera = test::testCamera();
  camera.fx = -464;
  EXPECT_THROW(camera.validate(), OptionError);
  camera = test::testCamera();
  camera.height = 0;
  EXPECT_THROW(camera.validate(), OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
