#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "ground_scale_vo/scale/direct_plane_estimator.hpp"
#include "support/road_image.hpp"

namespace ground_scale_vo {
namespace {

/// Of the step between two frames, the part during the readout: 30 ms at 10 Hz.
constexpr double kReadoutPart = 0.3;

/// Image of a rolling shutter, in strips of rows with one pose each.
cv::Mat rollingRoadImage(const RoadScene& scene, double at) {
  constexpr int kRows = 2;
  cv::Mat image;
  for (int first = 0; first < scene.camera.height; first += kRows) {
    RoadScene strip = scene;
    strip.camera.height = std::min(kRows, scene.camera.height - first);
    strip.camera.cy -= first;
    const double share = scene.camera.readoutShare(first + (strip.camera.height - 1) / 2.0);
    image.push_back(roadImage(strip, at + kReadoutPart * share * scene.step));
  }
  return image;
}

/// Relative error of the height.
double errorWith(const RoadScene& scene, bool is_compensated) {
  DirectPlaneEstimator estimator({});
  DirectPlaneEstimator::Result result;
  for (std::uint32_t i = 0; i < 4; ++i) {
    VoFrame frame = scene.frame(i);
    if (is_compensated) {
      frame.readout_motion.tail<3>() =
          scene.rotation().transpose() * Eigen::Vector3d(0, 0, kReadoutPart * scene.step);
    }
    result = estimator.estimate(frame, rollingRoadImage(scene, scene.step * i),
                                priorOf(scene, 0.002), std::nullopt, scene.height);
  }
  EXPECT_EQ(result.status, ScaleReason::kNone);
  return std::abs(result.plane.height / scene.height - 1);
}

TEST(RollingShutter, PatchesAreWarpedWithThePosesOfTheirRows) {
  RoadScene scene;
  scene.pitch = 0.03;
  scene.step = 0.5 * scene.height;
  scene.addPatch(1500, -2.5, 2.5, 0, 15, 0, 1);
  EXPECT_GT(errorWith(scene, false), 0.02);
  EXPECT_LT(errorWith(scene, true), 0.005);
}

}  // namespace
}  // namespace ground_scale_vo
