#include "ground_scale_vo/vo/camera.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>

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

TEST(Camera, HasTwoFocalLengths) {
  const PinholeCamera camera{640, 480, 500, 410, 320, 240};
  EXPECT_LT((camera.ray({420, 322}) - Eigen::Vector3d(0.2, 0.2, 1)).norm(), 1e-12);
  EXPECT_LT((camera.project({0.4, 0.4, 2}) - Eigen::Vector2d(420, 322)).norm(), 1e-9);
}

TEST(Camera, requiresAnImageOfItsSize) {
  EXPECT_NO_THROW(requireImage(cv::Mat(248, 800, CV_8UC1), testCamera()));
  try {
    requireImage(cv::Mat(248, 801, CV_8UC1), testCamera());
    FAIL() << "accepted";
  } catch (const OptionError& error) {
    EXPECT_STREQ(error.what(), "image is 801x248, the camera 800x248");
  }
}

TEST(Camera, requiresAMaskOfItsSize) {
  PinholeCamera camera = testCamera();
  camera.width = 80;
  camera.height = 60;
  EXPECT_NO_THROW(requireMask({}, camera));
  EXPECT_NO_THROW(requireMask(cv::Mat(60, 80, CV_8UC1), camera));
  EXPECT_THROW(requireMask(cv::Mat(60, 80, CV_8UC3), camera), OptionError);
  EXPECT_THROW(requireMask(cv::Mat(59, 80, CV_8UC1), camera), OptionError);
  EXPECT_THROW(requireMask(cv::Mat(60, 79, CV_8UC1), camera), OptionError);
  try {
    requireMask(cv::Mat(80, 60, CV_8UC1), camera, "--mask hood.png");
    FAIL() << "accepted";
  } catch (const OptionError& error) {
    EXPECT_STREQ(error.what(), "--mask hood.png is 60x80, the camera 80x60");
  }
}

TEST(Camera, rejectsInvalidIntrinsics) {
  PinholeCamera camera = testCamera();
  EXPECT_NO_THROW(camera.validate());
  camera.fx = -464;
  EXPECT_THROW(camera.validate(), OptionError);
  const std::pair<const char*, double PinholeCamera::*> fields[] = {{"fx", &PinholeCamera::fx},
                                                                    {"fy", &PinholeCamera::fy},
                                                                    {"cx", &PinholeCamera::cx},
                                                                    {"cy", &PinholeCamera::cy}};
  for (const auto& [name, field] : fields) {
    camera = testCamera();
    camera.*field = std::numeric_limits<double>::quiet_NaN();
    try {
      camera.validate();
      ADD_FAILURE() << name << " accepted";
    } catch (const OptionError& error) {
      const std::string expected = std::string("camera ") + name + " [px] ";
      EXPECT_EQ(std::string(error.what()).substr(0, expected.size()), expected);
    }
  }
  camera = testCamera();
  camera.width = 0;
  EXPECT_THROW(camera.validate(), OptionError);
  camera = testCamera();
  camera.height = 0;
  EXPECT_THROW(camera.validate(), OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
