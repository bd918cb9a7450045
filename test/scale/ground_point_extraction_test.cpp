#include "ground_scale_vo/scale/ground_point_extraction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "support/road_scene.hpp"

namespace ground_scale_vo {
namespace {

MotionHistory::Chord chordOf(const RoadScene& scene) {
  return {scene.rotation().transpose() * Eigen::Vector3d::UnitZ(), 5.0};
}

GroundPointExtraction::Result extract(const RoadScene& scene, const VoFrame& frame,
                                      const GroundPointExtraction::Options& options = {}) {
  return GroundPointExtraction(options).extract(frame, priorOf(scene), chordOf(scene),
                                                Eigen::Isometry3d::Identity());
}

/// 400 points, ids 1 to 400.
RoadScene roadAhead() {
  RoadScene scene;
  scene.addPatch(400, -1.0, 1.0, 1.0, 9.0, 0, 1);
  return scene;
}

TEST(GroundPointExtraction, ExactRoadGivesItsPlane) {
  RoadScene scene = roadAhead();
  scene.roll = 0.03;
  const auto result = extract(scene, scene.frame(0));
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height, 0.7, 1e-4);
  EXPECT_NEAR((result.plane.n_c - scene.normal()).norm(), 0, 1e-3);
  EXPECT_GT(result.triangles, 100);
  EXPECT_GT(result.ground_triangles, result.triangles * 9 / 10);
  EXPECT_GT(result.points.size(), 100u);
}

TEST(GroundPointExtraction, TolerancesFollowTheUncertaintyOfThePrior) {
  RoadScene scene = roadAhead();
  scene.pitch = 0;
  const NormalPrior level = priorOf(scene, 0.13);
  for (const double roll : {-0.26, 0.26}) {
    scene.roll = roll;
    const auto extractWith = [&](double roll_sigma) {
      NormalPrior prior = level;
      prior.roll_sigma = roll_sigma;
      return GroundPointExtraction({}).extract(scene.frame(0), prior, chordOf(scene),
                                               Eigen::Isometry3d::Identity());
    };
    const auto uncertain = extractWith(0.13);
    ASSERT_EQ(uncertain.status, ScaleReason::kNone) << roll;
    EXPECT_NEAR(uncertain.plane.height, 0.7, 1e-3) << roll;
    EXPECT_NEAR((uncertain.plane.n_c - scene.normal()).norm(), 0, 1e-3) << roll;
    EXPECT_NE(extractWith(0.01).status, ScaleReason::kNone) << roll;
  }
}

TEST(GroundPointExtraction, WallsAcrossAndAlongThePathAreNotGround) {
  RoadScene scene = roadAhead();
  const std::size_t on_road = scene.points.size();
  scene.addWall(150, -0.7, 0.7, 0.6, 5.0, 2);  // back of a car
  for (int i = 0; i < 60; ++i)
    scene.points.emplace_back(0.95, -0.01 * i, 2.0 + 0.1 * i);  // its side
  const auto result = extract(scene, scene.frame(0));
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height, 0.7, 0.01);
  std::size_t on_wall = 0;
  for (const GroundPoint& point : result.points) {
    if (point.id <= on_road) continue;
    ++on_wall;
    EXPECT_LT(-scene.points[point.id - 1].y(), 0.07);  // only the base of the wall
  }
  EXPECT_LT(on_wall, result.points.size() / 10);
}

TEST(GroundPointExtraction, KerbInTheMinorityIsRejectedInAnyUnit) {
  std::vector<std::uint64_t> ids[3];
  for (int k = 0; k < 3; ++k) {
    const double unit = std::pow(16, k - 1);  // the same rounding
    RoadScene scene = roadAhead();
    scene.depth_sigma = 0.005;
    scene.addPatch(120, 0.7, 1.0, 1.0, 9.0, -0.1, 3);  // pavement, 14 % of the camera height up
    const auto result = extract(scene, inUnit(unit, scene).frame(0));
    ASSERT_EQ(result.status, ScaleReason::kNone);
    EXPECT_NEAR(result.plane.height / unit, 0.7, 0.005);
    for (const GroundPoint& point : result.points) {
      EXPECT_LE(point.id, 400u);
      ids[k].push_back(point.id);
    }
    EXPECT_GT(ids[k].size(), 100u);
    EXPECT_EQ(ids[k], ids[0]);
  }
}

TEST(GroundPointExtraction, OnlyTheLaneIsUsedWhileItHasEnoughFeatures) {
  RoadScene scene = roadAhead();
  scene.addPatch(400, 1.2, 2.5, 1.0, 9.0, 0, 4);
  // Clearly outside the lane, whose half width is 1.2 camera heights; the camera height is 0.7.
  const auto count_outside = [&](const GroundPointExtraction::Result& result) {
    return std::count_if(result.points.begin(), result.points.end(),
                         [](const GroundPoint& p) { return p.p_c.x() > 1.4 * 0.7; });
  };
  EXPECT_EQ(count_outside(extract(scene, scene.frame(0))), 0);
  GroundPointExtraction::Options options;
  options.min_lane_features = 100000;
  EXPECT_GT(count_outside(extract(scene, scene.frame(0), options)), 50);
}

TEST(GroundPointExtraction, TheRegionHasLimits) {
  const RoadScene scene = roadAhead();
  GroundPointExtraction::Options options;
  options.min_ahead_heights = 4;
  options.max_ahead_heights = 8;
  const auto result = extract(scene, scene.frame(0), options);
  ASSERT_EQ(result.status, ScaleReason::kNone);
  for (const GroundPoint& point : result.points) {
    EXPECT_GT(point.p_c.z(), 3.8 * scene.height);
    EXPECT_LT(point.p_c.z(), 8.1 * scene.height);
  }
}

TEST(GroundPointExtraction, PlaneAboveOrBehindTheCameraIsNoGround) {
  RoadScene scene;
  scene.addPatch(400, -1.0, 1.0, 1.0, 9.0, -2.0, 1);  // a ceiling
  const auto ceiling = extract(scene, scene.frame(0));
  EXPECT_NE(ceiling.status, ScaleReason::kNone);
  EXPECT_TRUE(ceiling.points.empty());

  VoFrame behind = roadAhead().frame(0);
  for (TrackedFeature& feature : behind.features) feature.p_c = -feature.p_c;
  EXPECT_EQ(extract(roadAhead(), behind).status, ScaleReason::kTooFewTriangles);
}

TEST(GroundPointExtraction, DegenerateInputIsRefusedByStatus) {
  RoadScene scene;
  EXPECT_EQ(extract(scene, scene.frame(0)).status, ScaleReason::kTooFewTriangles);
  scene.points = {{0, 0, 3}, {0.3, 0, 4}};
  EXPECT_EQ(extract(scene, scene.frame(0)).status, ScaleReason::kTooFewTriangles);
  scene.points.push_back({-0.4, 0, 5});
  EXPECT_EQ(extract(scene, scene.frame(0)).status, ScaleReason::kTooFewGroundPoints);
  scene.points.clear();
  for (int i = 0; i < 40; ++i) scene.points.emplace_back(0, 0, 2 + 0.2 * i);  // collinear
  EXPECT_NE(extract(scene, scene.frame(0)).status, ScaleReason::kNone);

  VoFrame same = roadAhead().frame(0);  // all at one pixel
  for (TrackedFeature& feature : same.features) feature.u = same.features[0].u;
  EXPECT_EQ(extract(roadAhead(), same).status, ScaleReason::kTooFewTriangles);
}

TEST(GroundPointExtraction, FeaturesWithoutAUsablePointAreIgnored) {
  const RoadScene scene = roadAhead();
  VoFrame frame = scene.frame(0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    if (i % 6 == 0) frame.features[i].has_point = false;
    if (i % 6 == 1) frame.features[i].p_c.y() = nan;
    if (i % 6 == 2) frame.features[i].u.x() = nan;
    if (i % 6 == 3) frame.features[i].depth_sigma = nan;
    if (i % 6 == 4) frame.features[i].depth_sigma = 0;
  }
  const auto result = extract(scene, frame);
  ASSERT_EQ(result.status, ScaleReason::kNone);
  EXPECT_NEAR(result.plane.height, 0.7, 1e-4);
  for (const GroundPoint& point : result.points) EXPECT_TRUE(point.p_c.allFinite());
  EXPECT_LE(result.points.size(), frame.features.size() / 6 + 1);
}

// As another odometry may report them.
TEST(GroundPointExtraction, FeaturesOutsideTheImageAreIgnored) {
  const RoadScene scene = roadAhead();
  const auto width = static_cast<float>(scene.camera.width);
  const auto height = static_cast<float>(scene.camera.height);
  GroundPointExtraction::Options options;
  options.min_lane_features = 100000;  // also of the wide region
  for (const Eigen::Vector2f& outside :
       {Eigen::Vector2f(-10, height - 1), Eigen::Vector2f(width + 10, height - 1),
        Eigen::Vector2f(width / 2, height + 10), Eigen::Vector2f(width / 2, -10)}) {
    VoFrame frame = scene.frame(0);
    const std::uint64_t id = frame.features[0].id;
    frame.features[0].u = outside;
    const auto result = extract(scene, frame, options);
    ASSERT_EQ(result.status, ScaleReason::kNone) << outside.transpose();
    for (const GroundPoint& point : result.points) EXPECT_NE(point.id, id) << outside.transpose();
  }
}

TEST(GroundPointExtraction, MotionTestRequiresNormalsPerpendicularToTheMotion) {
  const RoadScene scene = roadAhead();
  GroundPointExtraction::Options options;
  for (const double angle : {-0.2, 0.2}) {  // 11 deg off
    MotionHistory::Chord climbing = chordOf(scene);
    climbing.direction_c =
        Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitX()) * climbing.direction_c;
    const auto result = GroundPointExtraction(options).extract(
        scene.frame(0), priorOf(scene), climbing, Eigen::Isometry3d::Identity());
    EXPECT_EQ(result.ground_triangles, 0) << angle;
  }
  const auto without = GroundPointExtraction(options).extract(
      scene.frame(0), priorOf(scene), std::nullopt, Eigen::Isometry3d::Identity());
  EXPECT_EQ(without.status, ScaleReason::kNone);
}

TEST(GroundPointExtraction, FramePitchTestReplacesTheTestOfTheTriangles) {
  const RoadScene scene = roadAhead();
  GroundPointExtraction::Options options;
  options.frame_pitch_test = true;
  for (const double pitch : {-0.2, 0.0, 0.2}) {
    const Eigen::Isometry3d motion(Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX()));
    const auto pitching = GroundPointExtraction(options).extract(scene.frame(0), priorOf(scene),
                                                                 chordOf(scene), motion);
    EXPECT_EQ(pitching.ground_triangles > 0, pitch == 0) << pitch;
    RoadScene expected = scene;
    expected.pitch += pitch;
    const auto wrong_prior = GroundPointExtraction(options).extract(
        scene.frame(0), priorOf(expected, 0.01), std::nullopt, Eigen::Isometry3d::Identity());
    EXPECT_GT(wrong_prior.ground_triangles, 0) << pitch;
  }
}

}  // namespace
}  // namespace ground_scale_vo
