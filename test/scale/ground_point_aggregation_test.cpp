#include "ground_scale_vo/scale/ground_point_aggregation.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/common/error.hpp"

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

TEST(GroundPointAggregation, WindowLengthIsInCameraHeights) {
  GroundPointAggregation::Options options;
  options.window_heights = 2;  // 1.6 VO units: four frames
  GroundPointAggregation gpa(options);
  for (int i = 0; i < 10; ++i) {
    gpa.add(poseAt(0.5 * i), 0.5 * i, pointsAhead(20, 1 + 100u * static_cast<unsigned>(i)));
    gpa.estimate(poseAt(0.5 * i), 0.5 * i, prior(), kPlaneHeight);
  }
  EXPECT_EQ(gpa.estimate(poseAt(4.5), 4.5, prior(), kPlaneHeight).window.size(), 80u);
}

TEST(GroundPointAggregation, NumbersOfFramesAndPointsAreBounded) {
  GroundPointAggregation::Options options;
  options.max_frames = 3;
  GroundPointAggregation gpa(options);
  for (int i = 0; i < 10; ++i) {
    gpa.add(poseAt(0.01 * i), 0.01 * i, pointsAhead(20, 1 + 100u * static_cast<unsigned>(i)));
  }
  const auto window = gpa.estimate(poseAt(0.09), 0.09, prior(), kPlaneHeight).window;
  ASSERT_EQ(window.size(), 60u);
  EXPECT_NEAR(window.front().origin_c.z(), 0, 1e-9);     // the newest
  EXPECT_NEAR(window.back().origin_c.z(), -0.02, 1e-9);  // two frames before it
  GroundPointAggregation many({});
  many.add(poseAt(0), 0, pointsAhead(2000, 1));
  many.add(poseAt(0.5), 0.5, pointsAhead(2000, 10001));
  EXPECT_EQ(many.estimate(poseAt(0.5), 0.5, prior(), kPlaneHeight).window.size(), 3000u);
}

TEST(GroundPointAggregation, AFeatureCountsOnceWithItsNewestPoint) {
  auto older = pointsAhead(20, 1);
  for (GroundPoint& point : older) point.p_c.z() += 0.5;
  GroundPointAggregation once({});
  once.add(poseAt(0), 0, older);
  once.add(poseAt(0.5), 0.5, pointsAhead(20, 1));
  const auto result = once.estimate(poseAt(0.5), 0.5, prior(), kPlaneHeight);
  EXPECT_EQ(result.window.size(), 20u);
  EXPECT_EQ(result.window[0].origin_c.norm(), 0);

  GroundPointAggregation::Options options;
  options.unique_features = false;
  GroundPointAggregation copies(options);
  copies.add(poseAt(0), 0, older);
  copies.add(poseAt(0.5), 0.5, pointsAhead(20, 1));
  EXPECT_EQ(copies.estimate(poseAt(0.5), 0.5, prior(), kPlaneHeight).window.size(), 40u);
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

TEST(GroundPointAggregation, BadOptionsAreRefused) {
  GroundPointAggregation::Options options;
  options.max_frames = 0;
  EXPECT_THROW(GroundPointAggregation{options}, OptionError);
  options = {};
  options.min_frames = options.max_frames + 1;
  EXPECT_THROW(GroundPointAggregation{options}, OptionError);
  options = {};
  options.fit.min_points = 0;
  EXPECT_THROW(GroundPointAggregation{options}, OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
