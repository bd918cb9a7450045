#include "ground_scale_vo/vo/camera.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "ground_scale_vo/common/error.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::testCamera;

TEST(Camera, projectInvertsRay) {
  const PinholeCamera camera = testCamera();
  const Eigen::Vector2d u(123.25, 45.5);
  EXPECT_LT((camera.project(7.5 * camera.ray(u)) - u).norm(), 1e-9);
  EXPECT_NEAR(camera.project({0, 1.65, 10}).y(), 119 + 464 * 0.165, 1e-9);
}

TEST(Camera, rejectsInvalidIntrinsics) {
  PinholeCamera camera = testCamera();
  EXPECT_NO_THROW(camera.validate());
  camera.fx = -464;
  EXPECT_THROW(camera.validate(), OptionError);
  camera = testCamera();
  camera.cy = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(camera.validate(), OptionError);
  camera = testCamera();
  camera.width = 0;
  EXPECT_THROW(camera.validate(), OptionError);
}

TEST(Rectifier, withoutDistortionReturnsTheSameImage) {
  const Rectifier rectifier(testCamera(), DistortionModel::kNone, {});
  const cv::Mat raw(248, 800, CV_8UC1, cv::Scalar(7));
  EXPECT_EQ(rectifier.rectify(raw).data, raw.data);
}

TEST(Rectifier, movesASpotFromItsDistortedToItsPinholePosition) {
  const PinholeCamera camera = testCamera();
  const double k1 = -0.3;
  const Eigen::Vector2d x(0.4, 0.1);  // the spot's true direction
  const Eigen::Vector2d raw_x = x * (1 + k1 * x.squaredNorm());
  cv::Mat raw(camera.height, camera.width, CV_8UC1, cv::Scalar(0));
  const Eigen::Vector2d at = camera.project(raw_x.homogeneous());
  raw.at<unsigned char>(static_cast<int>(std::lround(at.y())),
                        static_cast<int>(std::lround(at.x()))) = 255;

  const Rectifier rectifier(camera, DistortionModel::kPlumbBob, {k1, 0, 0, 0, 0});
  const cv::Mat rectified = rectifier.rectify(raw);
  cv::Point brightest;
  cv::minMaxLoc(rectified, nullptr, nullptr, nullptr, &brightest);
  const Eigen::Vector2d expected = camera.project(x.homogeneous());
  EXPECT_NEAR(brightest.x, expected.x(), 1.5);
  EXPECT_NEAR(brightest.y, expected.y(), 1.5);
}

TEST(Rectifier, fisheyeFollowsTheAngleFromTheAxis) {
  const PinholeCamera camera = testCamera();
  const double theta = std::atan(0.5);
  cv::Mat raw(camera.height, camera.width, CV_8UC1, cv::Scalar(0));
  raw.at<unsigned char>(119, static_cast<int>(std::lround(camera.cx + camera.fx * theta))) = 255;
  const Rectifier rectifier(camera, DistortionModel::kEquidistant, {0, 0, 0, 0});
  cv::Point brightest;
  cv::minMaxLoc(rectifier.rectify(raw), nullptr, nullptr, nullptr, &brightest);
  EXPECT_NEAR(brightest.x, camera.cx + camera.fx * 0.5, 1.5);
}

TEST(Rectifier, rejectsWrongCoefficientsAndImages) {
  EXPECT_THROW(Rectifier(testCamera(), DistortionModel::kEquidistant, {0.1}), OptionError);
  EXPECT_THROW(Rectifier(testCamera(), DistortionModel::kPlumbBob, {0.1}), OptionError);
  EXPECT_THROW(Rectifier(testCamera(), DistortionModel::kPlumbBob, {0, 0, 0, NAN, 0}), OptionError);
  const Rectifier rectifier(testCamera(), DistortionModel::kNone, {});
  EXPECT_THROW(rectifier.rectify(cv::Mat(10, 10, CV_8UC1)), OptionError);
  EXPECT_THROW(rectifier.rectify(cv::Mat(248, 800, CV_8UC3)), OptionError);
  EXPECT_THROW(rectifier.rectify(cv::Mat()), OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
