#include <gtest/gtest.h>

#include "support/scene.hpp"
#include "vo/motion.hpp"

namespace ground_scale_vo {
namespace {

using test::angleBetween;
using test::pose;

constexpr std::int64_t kFramePeriod = 100000000;  // [ns]

/// From one image to the next.
Eigen::Isometry3d step() { return pose({0, 0.1, 0}, {0.2, 0, 1}); }

/// Pose i of a camera that makes this step in each period.
Eigen::Isometry3d poseAt(int i) {
  Eigen::Isometry3d T = pose({0.5, 0, 0.3}, {7, 8, 9});
  for (int k = 0; k < i; ++k) T = T * step();
  return T;
}

MotionModel drivenUntil(int i) {
  MotionModel motion(poseAt(0), 0);
  for (int k = 1; k <= i; ++k) motion.update(poseAt(k), k * kFramePeriod);
  return motion;
}

void expectPose(const Eigen::Isometry3d& actual, const Eigen::Isometry3d& expected,
                double tolerance = 1e-9) {
  EXPECT_LT(angleBetween(actual, expected), tolerance);
  EXPECT_LT((actual.translation() - expected.translation()).norm(), tolerance);
}

TEST(MotionModel, ContinuesWithTheLastVelocityInCameraAxes) {
  const MotionModel at_start(poseAt(0), 0);
  expectPose(at_start.predict(kFramePeriod), poseAt(0));
  MotionModel motion = drivenUntil(3);
  expectPose(motion.predict(4 * kFramePeriod), poseAt(4));
  EXPECT_DOUBLE_EQ(motion.stepsSince(5 * kFramePeriod), 2);
  // Per second: half of the step in half of the time, its rotation and its translation each.
  expectPose(motion.predict(3 * kFramePeriod + kFramePeriod / 2),
             poseAt(3) * pose({0, 0.05, 0}, {0.1, 0, 0.5}));
  const Eigen::Isometry3d correction = pose({0.1, 0.2, 0.3}, {1, -2, 3});
  motion.correct(correction);
  expectPose(motion.predict(4 * kFramePeriod), correction * poseAt(4));
}

TEST(MotionModel, PredictionEndsAndExtrapolationDoesNot) {
  const MotionModel motion = drivenUntil(2);
  expectPose(motion.predict(100 * kFramePeriod), motion.predict(1000 * kFramePeriod));
  expectPose(motion.extrapolate(22 * kFramePeriod), poseAt(2) * pose({0, 2, 0}, {4, 0, 20}));
}

TEST(PixelPrediction, ByFlowIsProportionalToTheTime) {
  Feature feature;
  feature.u = {100, 50};
  feature.flow = {20, -10};  // [px/s]
  const auto predicted = predictPixelsByFlow({feature}, 0.5);
  EXPECT_EQ(predicted, std::vector<cv::Point2f>(1, {110, 45}));
}

}  // namespace
}  // namespace ground_scale_vo
