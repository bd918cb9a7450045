#include "scale/ground_points.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "support/road_scene.hpp"

namespace gsv {
namespace {

/// Of a scene, with a chord along the road.
RoadPrior movingPrior(const RoadScene& scene, double sigma = 0.01) {
  RoadPrior prior = priorOf(scene, sigma);
  prior.chord = Chord{prior.forward_c, 5.0};
  return prior;
}

GroundPoints extract(const VoFrame& frame, const RoadPrior& prior,
                     const GroundPointExtractionOptions& options = {}) {
  return extractGroundPoints(frame, prior, Eigen::Isometry3d::Identity(), options);
}

/// 400 points, ids 1 to 400.
RoadScene roadAhead() {
  RoadScene scene;
  scene.addPatch(400, -1.0, 1.0, 1.0, 9.0, 0, 1);
  return scene;
}

TEST(GroundPointExtraction, TolerancesFollowTheUncertaintyOfThePrior) {
  RoadScene scene = roadAhead();
  scene.pitch = 0;
  RoadPrior uncertain = movingPrior(scene, 0.13), certain = uncertain;
  certain.roll_sigma = 0.01;
  for (const double roll : {-0.26, 0.26}) {
    scene.roll = roll;
    const auto result = extract(scene.frame(0), uncertain);
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured) << roll;
    EXPECT_NEAR(result.plane.height, 0.7, 1e-3) << roll;
    EXPECT_NEAR((result.plane.n_c - scene.normal()).norm(), 0, 1e-3) << roll;
    EXPECT_NE(extract(scene.frame(0), certain).status, MeasurementStatus::kMeasured) << roll;
  }
}

TEST(GroundPointExtraction, WallsAcrossAndAlongThePathAreNotGround) {
  RoadScene scene = roadAhead();
  const std::size_t on_road = scene.points.size();
  scene.addWall(150, -0.7, 0.7, 0.6, 5.0, 2);  // back of a car
  for (int i = 0; i < 60; ++i)
    scene.points.emplace_back(0.95, -0.01 * i, 2.0 + 0.1 * i);  // its side
  const auto result = extract(scene.frame(0), movingPrior(scene));
  ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
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
    const auto result = extract(inUnit(unit, scene).frame(0), movingPrior(scene));
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
    EXPECT_NEAR(result.plane.height / unit, 0.7, 0.005);
    EXPECT_GT(result.points.size(), 100u);
    for (const GroundPoint& point : result.points) EXPECT_LE(point.id, 400u);
  }
}

TEST(GroundPointExtraction, TheRegionHasLimitsAndIsWideWhenTheLaneHasFewFeatures) {
  RoadScene scene = roadAhead();
  scene.addPatch(1000, -1.0, 1.0, 1.0, 9.0, 0, 2);
  scene.addPatch(400, 1.2, 2.5, 1.0, 9.0, 0, 4);
  GroundPointExtractionOptions options;
  options.max_ahead_heights = 8;
  for (const bool has_lane : {true, false}) {
    if (!has_lane) options.min_lane_features = 100000;
    const auto result = extract(scene.frame(0), movingPrior(scene), options);
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
    int outside = 0;
    for (const GroundPoint& point : result.points) {
      EXPECT_GT(std::hypot(point.p_c.x(), point.p_c.z()), 0.9 * scene.height);
      EXPECT_LT(point.p_c.z(), 8.1 * scene.height);
      outside += point.p_c.x() > 1.4 * scene.height;  // the half width of the lane is 1.2
    }
    EXPECT_EQ(outside == 0, has_lane);
  }
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
  GroundPointExtractionOptions options;
  options.min_lane_features = 100000;  // also of the wide region
  for (const auto& result :
       {extract(frame, movingPrior(scene)), extract(frame, movingPrior(scene), options)}) {
    ASSERT_EQ(result.status, MeasurementStatus::kMeasured);
    EXPECT_NEAR(result.plane.height, 0.7, 1e-4);
    for (const GroundPoint& point : result.points) EXPECT_EQ(point.id, 6u);
  }
}

TEST(GroundPointExtraction, MotionTestRequiresNormalsPerpendicularToTheMotion) {
  const RoadScene scene = roadAhead();
  for (const double angle : {-0.2, 0.2}) {  // 11 deg off
    RoadPrior climbing = movingPrior(scene);
    climbing.chord->direction_c =
        Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitX()) * climbing.forward_c;
    EXPECT_EQ(extract(scene.frame(0), climbing).ground_triangles, 0) << angle;
  }
  EXPECT_EQ(extract(scene.frame(0), priorOf(scene)).status, MeasurementStatus::kMeasured);
}

TEST(GroundPointExtraction, FramePitchTestReplacesTheTestOfTheTriangles) {
  const RoadScene scene = roadAhead();
  GroundPointExtractionOptions options;
  options.frame_pitch_test = true;
  for (const double pitch : {-0.2, 0.0, 0.2}) {
    RoadScene expected = scene;
    expected.pitch += pitch;  // a wrong prior has no effect
    const Eigen::Isometry3d motion(Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX()));
    for (const Eigen::Isometry3d& last_motion : {motion, Eigen::Isometry3d::Identity()}) {
      const auto result =
          extractGroundPoints(scene.frame(0), priorOf(expected, 0.01), last_motion, options);
      const bool is_level = last_motion.linear().isIdentity();
      EXPECT_EQ(result.ground_triangles > 0, is_level) << pitch;
    }
  }
}

constexpr double kPlaneHeight = 0.8;  // [VO units]

/// Appends a level camera after a distance of z along the optical axis [VO units], with n ground
/// points ahead of it. World axes differ from the camera's.
void add(CameraPath* path, double z, int n) {
  const Eigen::Isometry3d T_w_first(Eigen::AngleAxisd(0.8, Eigen::Vector3d::UnitY()));
  CameraPath::Pose& pose = path->add({0, T_w_first * Eigen::Translation3d(0, 0, z)});
  pose.prior.pitch_sigma = pose.prior.roll_sigma = 0.02;
  for (int i = 0; i < n; ++i) {
    const double depth = 2 + 0.37 * (i % 11);
    pose.ground_points.push_back({static_cast<std::uint64_t>(1 + 1e6 * z + i),
                                  {0.1 * (i % 7) - 0.3, kPlaneHeight, depth},
                                  Eigen::Vector3d::Zero(),
                                  depth,
                                  0.01 * depth});
  }
}

/// In the newest camera.
std::vector<GroundPoint> windowOf(const CameraPath& path,
                                  const GroundPointAggregationOptions& options = {}) {
  return aggregateGroundPoints(path, path.newest().T_w_c, kPlaneHeight, options);
}

TEST(GroundPointAggregation, PointsAreMovedIntoTheNewestFrame) {
  CameraPath path;
  for (int i = 0; i < 4; ++i) add(&path, 0.5 * i, 15);
  const std::vector<GroundPoint> window = windowOf(path);
  EXPECT_EQ(window.size(), 60u);
  for (const GroundPoint& point : window) EXPECT_NEAR(point.p_c.y(), kPlaneHeight, 1e-9);
  // The points of the oldest frame, 1.5 VO units behind, come last.
  EXPECT_NEAR((window.back().origin_c - Eigen::Vector3d(0, 0, -1.5)).norm(), 0, 1e-9);
  EXPECT_NEAR(window[45].p_c.z(), 2 - 1.5, 1e-9);
  EXPECT_NEAR(window[45].depth, 2, 1e-9);
}

TEST(GroundPointAggregation, TheWindowIsBounded) {
  // Points in the window after ten frames, and the z of its oldest camera.
  const auto sizeOf = [](const GroundPointAggregationOptions& options, double step, int points) {
    CameraPath path;
    for (int i = 0; i < 10; ++i) {
      add(&path, step * i, points);
      add(&path, step * i, 0);  // without ground points it does not count
    }
    const auto window = windowOf(path, options);
    EXPECT_NEAR(window.front().origin_c.z(), 0, 1e-9);  // the newest
    return std::pair(window.size(), window.back().origin_c.z());
  };
  GroundPointAggregationOptions options;
  options.window_heights = 2;  // 1.6 VO units: four frames
  const auto [by_length, length] = sizeOf(options, 0.5, 20);
  EXPECT_EQ(by_length, 80u);
  EXPECT_NEAR(length, -1.5, 1e-9);
  options.max_frames = 3;
  const auto [by_frames, three_frames] = sizeOf(options, 0.01, 20);
  EXPECT_EQ(by_frames, 60u);
  EXPECT_NEAR(three_frames, -0.02, 1e-9);
  EXPECT_LT(sizeOf({}, 0.1, 2000).first, 10000u);  // also the number of points
}

}  // namespace
}  // namespace gsv
