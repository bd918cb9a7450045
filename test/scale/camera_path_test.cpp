#include "ground_scale_vo/scale/camera_path.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

/// Cameras at z = 0, 1 ... n - 1, each with its z as standard deviation of the prior.
CameraPath pathOf(int n, double max_length) {
  CameraPath path;
  for (int i = 0; i < n; ++i) {
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
    T_w_c.translation().z() = i;
    NormalPrior prior;
    prior.pitch_sigma = i;
    path.add(T_w_c, prior, i == 0 ? 0 : 1, max_length);
  }
  return path;
}

TEST(CameraPath, TheNearestCameraComesWithItsPrior) {
  const CameraPath path = pathOf(10, 100);
  const CameraPath::Camera& camera = path.nearest({0.5, 1, 3.2});
  EXPECT_EQ(camera.T_w_c.translation().z(), 3);
  EXPECT_EQ(camera.prior.pitch_sigma, 3);
  EXPECT_EQ(path.nearest({0, 1, 20}).T_w_c.translation().z(), 9);  // road ahead: the newest
  EXPECT_EQ(path.nearest({0, 1, -20}).T_w_c.translation().z(), 0);
}

TEST(CameraPath, CamerasFartherBackThanTheMaximumAreDropped) {
  EXPECT_EQ(pathOf(10, 4.5).nearest({0, 0, 0}).T_w_c.translation().z(), 5);
  EXPECT_GT(pathOf(3000, 1e9).nearest({0, 0, 0}).T_w_c.translation().z(), 0);  // bounded
}

}  // namespace
}  // namespace ground_scale_vo
