#include "ground_scale_vo/scale/ground_point_extraction.hpp"

#include <gtest/gtest.h>

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
  RoadScene scene = roadAhead();
  scene.depth_sigma = 0.005;
  scene.addPatch(120, 0.7, 1.0, 1.0, 9.0, -0.1, 3);  // pavement, 14 % of the camera height up
  for (const double unit : {1.0, 16.0}) {
    const auto result = extract(scene, inUnit(unit, scene).frame(0));
    ASSERT_EQ(result.status, ScaleReason::kNone);
    EXPECT_NEAR(result.plane.height / unit, 0.7, 0.005);
    EXPECT_GT(result.points.size(), 100u);
    for (const GroundPoint& point : result.points) EXPECT_LE(point.id, 400u);
  }
}

TEST(GroundPointExtraction, TheRegionHasLimitsAndIsWideWhenTheLaneHasFewFeatures) {
  RoadScene scene = roadAhead();
  scene.addPatch(1000, -1.0, 1.0, 1.0, 9.0, 0, 2);
  scene.addPatch(400, 1.2, 2.5, 1.0, 9.0, 0, 4);
  GroundPointExtraction::Options options;
  options.min_ahead_heights = 4;
  options.max_ahead_heights = 8;
  for (const bool has_lane : {true, false}) {
    if (!has_lane) options.min_lane_features = 100000;
    const auto result = extract(scene, scene.frame(0), options);
    ASSERT_EQ(result.status, ScaleReason::kNone);
    int outside = 0;
    for (const GroundPoint& point : result.points) {
      EXPECT_GT(std::hypot(point.p_c.x(), point.p_c.z()), 3.8 * scene.height);
      EXPECT_LT(point.p_c.z(), 8.1 * scene.height);
      outside += point.p_c.x() > 1.4 * scene.height;  // the half width of the lane is 1.2
    }
    EXPECT_EQ(outside == 0, has_lane);
  }
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
  scene.points.clear();
  scene.addPatch(400, -1.0, 1.0, 1.0, 9.0, -2.0, 1);  // a ceiling
  const auto ceiling = extract(scene, scene.frame(0));
  EXPECT_NE(ceiling.status, ScaleReason::kNone);
  EXPECT_TRUE(ceiling.points.empty());

  VoFrame same = roadAhead().frame(0), behind = same;
  for (TrackedFeature& feature : same.features) feature.u = same.features[0].u;
  EXPECT_EQ(extract(roadAhead(), same).status, ScaleReason::kTooFewTriangles);
  for (TrackedFeature& feature : behind.features) feature.p_c = -feature.p_c;
  EXPECT_EQ(extract(roadAhead(), behind).status, ScaleReason::kTooFewTriangles);
}

// Outside the image: as another odometry may report them.
TEST(GroundPointExtraction, FeaturesWithoutAUsablePointOrOutsideTheImageAreIgnored) {
  const RoadScene scene = roadAhead();
  VoFrame frame = scene.frame(0);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const auto width = static_cast<float>(scene.camera.width);
  const auto height = static_cast<float>(scene.camera.height);
  const Eigen::Vector2f outside[] = {
      {-10, height - 1}, {width + 10, height - 1}, {width / 2, height + 10}, {width / 2, -10}};
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    TrackedFeature& feature = frame.features[i];
    if (i % 7 == 0) feature.has_point = false;
    if (i % 7 == 1) feature.p_c.y() = kNan;
    if (i % 7 == 2) feature.u.x() = kNan;
    if (i % 7 == 3) feature.depth_sigma = kNan;
    if (i % 7 == 4) feature.depth_sigma = 0;
    if (i % 7 == 5) feature.u = outside[i % 4];
    feature.id = i % 7;
  }
  GroundPointExtraction::Options options;
  options.min_lane_features = 100000;  // also of the wide region
  for (const auto& result : {extract(scene, frame), extract(scene, frame, options)}) {
    ASSERT_EQ(result.status, ScaleReason::kNone);
    EXPECT_NEAR(result.plane.height, 0.7, 1e-4);
    for (const GroundPoint& point : result.points) EXPECT_EQ(point.id, 6u);
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
    RoadScene expected = scene;
    expected.pitch += pitch;  // a wrong prior has no effect
    const Eigen::Isometry3d motion(Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX()));
    for (const Eigen::Isometry3d& last_motion : {motion, Eigen::Isometry3d::Identity()}) {
      const auto result = GroundPointExtraction(options).extract(
          scene.frame(0), priorOf(expected, 0.01), std::nullopt, last_motion);
      const bool is_level = last_motion.linear().isIdentity();
      EXPECT_EQ(result.ground_triangles > 0, is_level) << pitch;
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo
