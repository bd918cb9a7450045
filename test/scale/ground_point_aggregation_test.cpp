#include "ground_scale_vo/scale/ground_point_aggregation.hpp"

#include <gtest/gtest.h>

#include <utility>

namespace ground_scale_vo {
namespace {

constexpr double kPlaneHeight = 0.8;  // [VO units]

/// Ground points ahead of a level camera: ids first .. first + n - 1.
std::vector<GroundPoint> pointsAhead(int n, std::uint64_t first) {
  std::vector<GroundPoint> points;
  for (int i = 0; i < n; ++i) {
    const double z = 2 + 0.37 * (i % 11);
    points.push_back(
        {first + static_cast<std::uint64_t>(i), {0.1 * (i % 7) - 0.3, kPlaneHeight, z}, 0.01 * z});
  }
  return points;
}

/// Pose after a distance of z along the optical axis [VO units].
Eigen::Isometry3d poseAt(double z) {
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
  T_w_c.rotate(
      Eigen::AngleAxisd(0.8, Eigen::Vector3d::UnitY()));  // world axes differ from the camera's
  T_w_c.translation() = T_w_c.linear() * Eigen::Vector3d(0, 0, z);
  return T_w_c;
}

NormalPrior prior() {
  NormalPrior p;
  p.pitch_sigma = p.roll_sigma = 0.02;
  return p;
}

TEST(GroundPointAggregation, PointsAreMovedIntoTheNewestFrame) {
  GroundPointAggregation gpa({});
  for (int i = 0; i < 4; ++i) {
    gpa.add(poseAt(0.5 * i), 0.5 * i, pointsAhead(15, 1 + 100u * static_cast<unsigned>(i)));
  }
  const auto result = gpa.estimate(poseAt(1.5), 1.5, prior(), kPlaneHeight);
  ASSERT_EQ(result.fit.status, ScaleReason::kNone);
  EXPECT_EQ(result.window.size(), 60u);
  EXPECT_NEAR(result.fit.plane.height, kPlaneHeight, 1e-5);
  for (const PlanePoint& point : result.window) EXPECT_NEAR(point.p_c.y(), kPlaneHeight, 1e-9);
  // The points of the oldest frame, 1.5 VO units behind, come last.
  EXPECT_NEAR((result.window.back().origin_c - Eigen::Vector3d(0, 0, -1.5)).norm(), 0, 1e-9);
  EXPECT_NEAR(result.window[45].p_c.z(), 2 - 1.5, 1e-9);
  EXPECT_NEAR(result.window[45].depth, 2, 1e-9);
}

TEST(GroundPointAggregation, TheWindowIsBounded) {
  // Points in the window after ten frames, and the z of its oldest camera.
  const auto windowOf = [](const GroundPointAggregation::Options& options, double step,
                           int points) {
    GroundPointAggregation gpa(options);
    GroundPointAggregation::Result result;
    for (int i = 0; i < 10; ++i) {
      gpa.add(poseAt(step * i), step * i,
              pointsAhead(points, 1 + 10000u * static_cast<unsigned>(i)));
      result = gpa.estimate(poseAt(step * i), step * i, prior(), kPlaneHeight);
    }
    EXPECT_NEAR(result.window.front().origin_c.z(), 0, 1e-9);  // the newest
    return std::pair(result.window.size(), result.window.back().origin_c.z());
  };
  GroundPointAggregation::Options options;
  options.window_heights = 2;  // 1.6 VO units: four frames
  const auto [by_length, length] = windowOf(options, 0.5, 20);
  EXPECT_EQ(by_length, 80u);
  EXPECT_NEAR(length, -1.5, 1e-9);
  options.max_frames = 3;
  const auto [by_frames, three_frames] = windowOf(options, 0.01, 20);
  EXPECT_EQ(by_frames, 60u);
  EXPECT_NEAR(three_frames, -0.02, 1e-9);
  EXPECT_LT(windowOf({}, 0.1, 2000).first, 10000u);  // also the number of points
}

TEST(GroundPointAggregation, AFeatureCountsOnceWithItsNewestPoint) {
  auto older = pointsAhead(20, 1);
  for (GroundPoint& point : older) point.p_c.z() += 0.5;
  for (const bool unique : {true, false}) {
    GroundPointAggregation::Options options;
    options.unique_features = unique;
    GroundPointAggregation gpa(options);
    gpa.add(poseAt(0), 0, older);
    gpa.add(poseAt(0.5), 0.5, pointsAhead(20, 1));
    const auto result = gpa.estimate(poseAt(0.5), 0.5, prior(), kPlaneHeight);
    EXPECT_EQ(result.window.size(), unique ? 20u : 40u);
    EXPECT_EQ(result.window[0].origin_c.norm(), 0);
  }
}

TEST(GroundPointAggregation, EmptyAndResetWindowsAreReported) {
  GroundPointAggregation gpa({});
  EXPECT_EQ(gpa.estimate(poseAt(0), 0, prior(), kPlaneHeight).fit.status,
            ScaleReason::kTooFewGroundPoints);
  gpa.add(poseAt(0), 0, pointsAhead(30, 1));
  EXPECT_EQ(gpa.estimate(poseAt(0), 0, prior(), kPlaneHeight).fit.status, ScaleReason::kNone);
  gpa.reset();
  EXPECT_TRUE(gpa.estimate(poseAt(0), 0, prior(), kPlaneHeight).window.empty());
}

}  // namespace
}  // namespace ground_scale_vo
