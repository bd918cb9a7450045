#include "scale/road.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ground_scale_vo {
namespace {

constexpr double kCameraHeight = 2;  // [VO units]
constexpr double kRadius = 8;        // of the bend [camera heights]: 13 m at 1.65 m
constexpr double kChord = 3;         // [camera heights]
constexpr double kHalfWidth = 1;     // [camera heights]

/// Viewing ray of a level camera to a point on the road [camera heights].
Eigen::Vector3d rayTo(double left, double ahead) {
  return Eigen::Vector3d(-left, 1, ahead) / ahead;
}

/// Of a camera that drives through a bend to one side (1 left, -1 right, 0: straight).
LaneRegion laneRegion(int side, double height) {
  RoadPrior prior;
  prior.chord = Chord{prior.forward_c, kChord * kCameraHeight, side * kChord / kRadius * prior.n_c};
  return LaneRegion(prior, height, 1.5, 10, kHalfWidth);
}

/// Offset of the circular path from the chord's direction, to the left [camera heights].
double pathAt(int side, double ahead) {
  const double heading = kChord / (2 * kRadius);  // relative to the chord
  const double angle = std::asin(std::sin(heading) + ahead / kRadius);
  return side * kRadius * (std::cos(heading) - std::cos(angle));
}

TEST(LaneRegion, FollowsThePathThroughABend) {
  for (const int side : {-1, 1}) {
    const LaneRegion bent = laneRegion(side, kCameraHeight),
                     straight = laneRegion(0, kCameraHeight);
    for (const double ahead : {2.0, 3.0, 4.0}) {
      const double path = pathAt(side, ahead);
      EXPECT_TRUE(bent.contains(rayTo(path, ahead))) << side << " " << ahead;
      EXPECT_FALSE(bent.contains(rayTo(path - side * 1.6 * kHalfWidth, ahead))) << ahead;
    }
    // At four camera heights, the straight region and the one of the bend no longer overlap.
    EXPECT_FALSE(straight.contains(rayTo(pathAt(side, 4), 4)));
    EXPECT_TRUE(straight.contains(rayTo(0, 4)));
    EXPECT_FALSE(bent.contains(rayTo(0, 4)));
  }
}

TEST(LaneRegion, IsTheSameBehindTheVehicle) {
  RoadPrior backward;
  backward.forward_c = -backward.forward_c;
  backward.chord =
      Chord{backward.forward_c, kChord * kCameraHeight, kChord / kRadius * backward.n_c};
  const LaneRegion behind(backward, kCameraHeight, 1.5, 10, kHalfWidth);
  EXPECT_TRUE(behind.contains(rayTo(0, 2)));
  // The chord ends at the camera, so the driven path starts at a distance of kChord in the image.
  EXPECT_TRUE(behind.contains(rayTo(0, kChord)));
  EXPECT_FALSE(behind.contains(rayTo(0, 9)));
}

/// Prior of a level camera that looks to the left of the direction of motion.
RoadPrior levelPrior(double yaw) {
  RoadPrior prior;
  prior.forward_c = {std::sin(yaw), 0, std::cos(yaw)};
  return prior;
}

TEST(LaneRegion, OffsetIsZeroWhileThePathIsVisible) {
  const PinholeCamera kitti{1241, 376, 718.9, 718.9, 607.2, 185.2};
  for (const double yaw : {0.0, 0.2, -0.3, M_PI}) {
    EXPECT_EQ(visibleRegionOffset(kitti, levelPrior(yaw)), 0) << yaw;
  }
  PinholeCamera tele = kitti;
  tele.fx = tele.fy = 4000;
  EXPECT_EQ(visibleRegionOffset(tele, levelPrior(0)), 0);
  PinholeCamera sky = kitti;
  sky.cy = 500;
  EXPECT_EQ(visibleRegionOffset(sky, levelPrior(0)), 0);
}

}  // namespace
}  // namespace ground_scale_vo
