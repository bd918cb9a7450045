#include "scale/road.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/se3.hpp"
#include "scale/camera_path.hpp"
#include "support/road_scene.hpp"

namespace gsv {
namespace {

constexpr double kCameraHeight = 2;  // [VO units]
constexpr double kRadius = 8;        // of the bend [camera heights]: 13 m at 1.65 m
constexpr double kChord = 3;         // [camera heights]
constexpr double kHalfWidth = 1;     // [camera heights]

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

/// Drives `heights` camera heights in steps of `step` [VO units].
void drive(Mounting* mounting, double pitch, double roll, double heights, double step = 0.4) {
  RoadScene scene;
  scene.pitch = pitch;
  scene.roll = roll;
  CameraPath path;
  const GroundPlane plane{scene.normal(), scene.height};
  for (double at = step; at < heights * scene.height + step; at += step) {
    path.add({0, scene.frameAt(0, at).T_w_c});
    mounting->update(mounting->prior(path, scene.height), &plane, step, scene.height);
  }
}

TEST(Mounting, DoesNotDependOnTheFrameRate) {
  Mounting slow({}), fast({});
  drive(&slow, 0.05, 0.04, 12);
  drive(&fast, 0.05, 0.04, 12, 0.04);
  EXPECT_GT(std::abs(slow.roll() - 0.04), 1e-4);  // not converged yet
  EXPECT_NEAR(fast.roll(), slow.roll(), 0.2 * std::abs(slow.roll() - 0.04));
  EXPECT_NEAR(fast.sigma(), slow.sigma(), 0.1 * slow.sigma());
}

TEST(Mounting, FollowsAChangeAfterTheForgettingDistance) {
  Mounting mounting({});
  drive(&mounting, 0, 0, 400);
  drive(&mounting, 0.02, 0.02, 1000);  // 5 times the distance
  EXPECT_NEAR(mounting.pitch(), 0.02, 0.002);
  EXPECT_NEAR(mounting.roll(), 0.02, 0.002);
}

TEST(Mounting, PitchAndRollAreLimitedTogether) {
  Mounting::Options options;
  options.max_tilt_rad = 0.1;
  for (const double pitch : {0.0, 0.3}) {
    for (const double roll : {-0.3, 0.3}) {
      Mounting mounting(options);
      drive(&mounting, pitch, roll, 400);
      EXPECT_NEAR(mounting.pitch(), std::min(pitch, 0.1), 0.01);
      EXPECT_NEAR(mounting.roll(), std::copysign(0.1, roll), 1e-9);
    }
  }
}

// A camera that looks to the left by yaw moves forward; the plane's tilt along the path is not
// used.
TEST(Mounting, IsEstimatedInAnyViewingDirection) {
  constexpr double kPitch = 0.15, kRoll = -0.12;
  const Eigen::Vector3d n_c(-std::sin(kRoll), -std::cos(kRoll) * std::cos(kPitch),
                            -std::cos(kRoll) * std::sin(kPitch));
  for (const double yaw : {0.0, 0.25 * M_PI, 0.5 * M_PI, -0.5 * M_PI, M_PI}) {
    SCOPED_TRACE(yaw);
    const Eigen::Vector3d view(std::sin(yaw), 0, std::cos(yaw));
    const Eigen::Vector3d ahead = (view - n_c.dot(view) * n_c).normalized();
    CameraPath path;
    Mounting mounting({});
    const GroundPlane plane{Eigen::AngleAxisd(0.1, n_c.cross(ahead)) * n_c, 1};
    for (int i = 0; i < 50; ++i) {
      path.add({0, Eigen::Isometry3d(Eigen::Translation3d(0.5 * i * ahead))});
      mounting.update(mounting.prior(path, 1), &plane, 0.5, 1);
    }
    EXPECT_NEAR(mounting.pitch(), kPitch, 3e-3);
    EXPECT_NEAR(mounting.roll(), kRoll, 3e-3);
    const RoadPrior prior = mounting.prior(path, 1);
    EXPECT_LT((prior.n_c - n_c).norm(), 3e-3);
    EXPECT_LT((prior.forward_c - ahead).norm(), 3e-3);
    EXPECT_LT(prior.pitch_sigma, 0.01);
    EXPECT_LT(prior.roll_sigma, 0.015);
  }
}

TEST(Mounting, SteepAndNoMotionDoNotUpdate) {
  Mounting mounting({});
  RoadPrior prior;
  mounting.update(prior, nullptr, 1, 1);
  for (const double slope : {0.9, 1.0}) {
    const Eigen::Vector3d direction(0, slope, std::sqrt(1 - slope * slope));
    prior.chord = Chord{direction, 1};
    mounting.update(prior, nullptr, 1, 1);
  }
  EXPECT_EQ(mounting.pitch(), 0);
  EXPECT_EQ(mounting.roll(), 0);
  const double initial_sigma = mounting.sigma();
  drive(&mounting, 0.02, 0, 40);
  EXPECT_NE(mounting.pitch(), 0);
  EXPECT_LT(mounting.sigma(), 0.5 * initial_sigma);
}

}  // namespace
}  // namespace gsv
