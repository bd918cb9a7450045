#include "scale/camera_path.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "ground_scale_vo/common/se3.hpp"

namespace gsv {
namespace {

TEST(CameraPath, TheTurnOfAChordIsInTheAxesOfItsEnd) {
  CameraPath path;
  Eigen::Isometry3d T_w_c(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX()));
  for (int i = 0; i < 10; ++i) {  // 1 VO unit ahead and a yaw of 0.1 rad, in camera axes
    path.add({0, T_w_c});
    T_w_c.translation() += T_w_c.linear().col(2);
    T_w_c.rotate(Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()));
  }
  EXPECT_NEAR((path.chord(3.5)->turn_c - Eigen::Vector3d(0, 0.4, 0)).norm(), 0, 1e-12);
  EXPECT_NEAR((rotationVector(path.lastMotion().linear()) - Eigen::Vector3d(0, -0.1, 0)).norm(), 0,
              1e-12);
}

TEST(CameraPath, TheNearestCameraIsAtMostTheGivenLengthBack) {
  CameraPath path;
  for (int i = 0; i < 10; ++i) {
    path.add({0, Eigen::Isometry3d(Eigen::Translation3d(0, 0, i))});
  }
  const auto nearest = [&](double z, double max_length) {
    return path.nearest({0, 1, z}, max_length).T_w_c.translation().z();
  };
  EXPECT_EQ(nearest(20, 5), 9);
  EXPECT_EQ(nearest(6.2, 5), 6);
  EXPECT_EQ(nearest(2, 5), 4);
  EXPECT_EQ(nearest(2, 0), 9);
}

}  // namespace
}  // namespace gsv
