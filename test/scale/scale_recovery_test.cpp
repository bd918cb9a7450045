#include "ground_scale_vo/scale/scale_recovery.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <tuple>

#include "ground_scale_vo/common/error.hpp"
#include "support/recovery_options.hpp"
#include "support/road_image.hpp"

namespace ground_scale_vo {
namespace {

RoadScene pitchedRoad() {
  RoadScene scene;
  scene.pitch = 0.03;
  scene.addPatch(6000, -2.5, 2.5, 0, 60, 0, 1);
  scene.depth_noise = 0.02;
  return scene;
}

const double kTrueScale = 1.65 / RoadScene().height;  // [m per VO unit]

/// Output for the last of the scene's first frames. They have images if has_images.
ScaleRecovery::Output run(ScaleRecovery* recovery, const RoadScene& scene, std::uint32_t frames,
                          bool has_images = false) {
  ScaleRecovery::Output output;
  for (std::uint32_t i = 0; i < frames; ++i) {
    output = recovery->process(scene.frame(i),
                               has_images ? roadImage(scene, scene.step * i) : cv::Mat());
  }
  return output;
}

TEST(ScaleRecovery, FindsTheScaleOfARoad) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  std::uint32_t first_known = 0;
  for (std::uint32_t i = 0; i < 80; ++i) {
    output = recovery.process(scene.frame(i));
    const bool known = output.scale.status != ScaleStatus::kUnknown;
    EXPECT_EQ(output.pose.has_value(), known);
    if (!known) {
      first_known = i + 1;
      EXPECT_EQ(output.scale.scale, 0);
      EXPECT_GT(output.scale.raw_scale, 0);  // measured, before the filter may start
      EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.05);
    }
  }
  EXPECT_LE(first_known, 10u);
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_EQ(output.scale.reason, ScaleReason::kNone);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.01);
  EXPECT_LT(std::abs(output.scale.scale - kTrueScale), 3 * output.scale.sigma);
  EXPECT_LT(output.scale.sigma / kTrueScale, 0.03);
  EXPECT_NEAR(output.scale.height, 0.7, 0.007);
  EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.01);
  EXPECT_NEAR(output.mounting_pitch, 0.03, 0.002);
  EXPECT_NEAR(output.pose->distance, kTrueScale * 0.4 * 79, 0.015 * kTrueScale * 0.4 * 79);
  EXPECT_GT(output.ground_feature_ids.size(), 50u);
  EXPECT_EQ(output.ground_points_c.size(), static_cast<std::size_t>(output.scale.window_points));
}

// A camera that faces backwards and vibrates: the height is that of an earlier camera of the path,
// and the direction of motion depends on the length over which it is averaged.
TEST(ScaleRecovery, IsTheSameInAnyUnit) {
  const auto outputIn = [](double unit) {
    RoadScene scene;
    scene.addPatch(4000, -1.5, 1.5, -40, 40, 0, 1);
    scene = inUnit(unit, scene);
    scene.step *= -1;
    ScaleRecovery recovery(recoveryOptions());
    ScaleRecovery::Output output;
    for (std::uint32_t i = 0; i < 40; ++i) {
      VoFrame frame = scene.frame(i);
      frame.T_w_c.translation().y() += 0.01 * unit * (i % 2);
      output = recovery.process(frame);
    }
    return output;
  };
  const auto expected = outputIn(1), output = outputIn(256);  // 256: the same rounding
  ASSERT_EQ(expected.scale.status, ScaleStatus::kOk);
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(256 * output.scale.scale / expected.scale.scale, 1, 1e-6);
  EXPECT_NEAR(256 * output.scale.sigma / expected.scale.sigma, 1, 1e-6);
  EXPECT_NEAR(output.feature_based.road_distance / expected.feature_based.road_distance, 256, 1e-3);
  EXPECT_NEAR(output.mounting_pitch, expected.mounting_pitch, 1e-6);
}

/// Pitch, roll and yaw of the mounting [rad].
class ScaleRecoveryMounting : public testing::TestWithParam<std::tuple<double, double, double>> {
 protected:
  RoadScene mounted() const {
    RoadScene scene;
    std::tie(scene.pitch, scene.roll, scene.yaw) = GetParam();
    scene.camera = {640, 360, 360, 360, 320, 180};
    return scene;
  }
};

TEST_P(ScaleRecoveryMounting, FeaturesGiveTheScale) {
  RoadScene scene = mounted();
  scene.addPatch(8000, -6, 6, -6, 40, 0, 1);
  scene.depth_noise = 0.02;
  ScaleRecovery recovery(recoveryOptions());
  const ScaleRecovery::Output output = run(&recovery, scene, 80);
  ASSERT_NE(output.scale.status, ScaleStatus::kUnknown);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.015);
  EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.02);
  const Eigen::Vector3d mounting_n_c = roadNormal(output.mounting_pitch, output.mounting_roll);
  EXPECT_NEAR((mounting_n_c - scene.normal()).norm(), 0, 0.02);
  EXPECT_GT(output.mounting_sigma, 0);
  EXPECT_LT(output.mounting_sigma, 0.03);
}

TEST_P(ScaleRecoveryMounting, DirectMeasurementsGiveTheScale) {
  RoadScene scene = mounted();
  scene.addPatch(600, -6, 6, -6, 40, 0, 1);
  ScaleRecovery::Options direct_only = recoveryOptions();
  direct_only.gpe.min_points = 1000000;
  ScaleRecovery recovery(direct_only);
  const ScaleRecovery::Output output = run(&recovery, scene, 24, true);
  ASSERT_NE(output.scale.status, ScaleStatus::kUnknown);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.015);
  EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Mountings, ScaleRecoveryMounting,
                         testing::Values(std::tuple(-0.06, -0.26, 0.0), std::tuple(0.35, 0.0, 0.0),
                                         std::tuple(0.0, 0.0, 0.25 * M_PI),
                                         std::tuple(0.1, 0.1, -0.5 * M_PI)));

TEST(ScaleRecovery, AVehicleAheadDoesNotBiasTheScale) {
  const RoadScene scene = pitchedRoad();
  RoadScene vehicle;  // its back, at a constant distance
  vehicle.pitch = scene.pitch;
  vehicle.addWall(250, -0.4, 0.4, 0.6, 3.0, 9);
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  for (std::uint32_t i = 0; i < 80; ++i) {
    VoFrame frame = scene.frame(i);
    for (TrackedFeature feature : vehicle.frameAt(i, 0).features) {
      feature.id += 100000;
      frame.features.push_back(feature);
    }
    output = recovery.process(frame);
  }
  ASSERT_NE(output.scale.status, ScaleStatus::kUnknown);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.02);
}

TEST(ScaleRecovery, HeldWithReasonWhenTheRoadIsHidden) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output = run(&recovery, scene, 40);
  ASSERT_EQ(output.scale.status, ScaleStatus::kOk);
  const ScaleEstimate known = output.scale;
  const double mounting_pitch = output.mounting_pitch;
  RoadScene pitched = scene;  // by the vehicle, against the road
  pitched.pitch += 0.05;
  for (std::uint32_t i = 40; i < 80; ++i) {
    VoFrame frame = scene.frame(i);
    frame.features.clear();
    frame.T_w_c.linear() = scene.rotation().transpose() * pitched.rotation();
    output = recovery.process(frame);
    EXPECT_EQ(output.scale.reason, ScaleReason::kTooFewTriangles);
  }
  // The normal follows the direction of motion.
  EXPECT_NEAR((output.scale.n_c - pitched.normal()).norm(), 0, 0.01);
  EXPECT_EQ(output.mounting_pitch, mounting_pitch) << "nothing of the road is seen";
  EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
  EXPECT_EQ(output.scale.scale, known.scale);
  EXPECT_GT(output.scale.sigma, 1.5 * known.sigma);
  EXPECT_EQ(output.scale.raw_scale, 0);
  EXPECT_TRUE(output.pose.has_value());
}

TEST(ScaleRecovery, StandstillHoldsTheScaleAndItsSigma) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output moving, still;
  for (std::uint32_t i = 0; i < 40; ++i) moving = recovery.process(scene.frame(i));
  for (std::uint32_t i = 40; i < 100; ++i) {
    VoFrame frame = scene.frameAt(i, 39 * scene.step + 0.0005 * (i % 3));
    frame.T_w_c.rotate(Eigen::AngleAxisd(0.01 * (i % 3), Eigen::Vector3d::UnitY()));
    still = recovery.process(frame);
    EXPECT_EQ(still.scale.status, ScaleStatus::kHeld);
    EXPECT_EQ(still.scale.reason, ScaleReason::kStandstill);
    EXPECT_EQ(still.scale.scale, moving.scale.scale);
    EXPECT_EQ(still.scale.sigma, moving.scale.sigma);
    EXPECT_EQ(still.scale.n_c, moving.scale.n_c);
  }
  EXPECT_NEAR(still.pose->distance, moving.pose->distance, 0.15);
  for (std::uint32_t i = 100; i < 120; ++i) {
    moving = recovery.process(scene.frameAt(i, scene.step * (i - 60)));
    EXPECT_EQ(moving.scale.status, ScaleStatus::kOk);
  }
}

// Each step alone is shorter than standstill_distance_heights, three are longer: at a high frame
// rate all motion is slow.
TEST(ScaleRecovery, SlowMotionAddsUp) {
  const RoadScene scene = pitchedRoad();
  const double slow_step =
      0.4 * ScaleRecovery::Options().standstill_distance_heights * scene.height;
  ScaleRecovery recovery(recoveryOptions());
  run(&recovery, scene, 40);
  int measured = 0;
  for (std::uint32_t i = 40; i < 70; ++i) {
    const auto output = recovery.process(scene.frameAt(i, 39 * scene.step + slow_step * (i - 39)));
    measured += output.scale.status == ScaleStatus::kOk;
  }
  EXPECT_NEAR(measured, 10, 1);
}

TEST(ScaleRecovery, StartsWithinTwoCameraHeights) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  VoFrame first = scene.frame(0);
  first.status = VoStatus::kInitialising;
  recovery.process(first);
  for (std::uint32_t i = 1; i < 20; ++i) {
    const auto output = recovery.process(scene.frame(i));
    if (!output.pose) continue;
    EXPECT_LE(i * scene.step, 2 * scene.height);
    EXPECT_NEAR(output.pose->distance, kTrueScale * scene.step * i, 0.1 * output.pose->distance);
    EXPECT_LT(std::abs(output.scale.scale - kTrueScale), 2 * output.scale.sigma);
    return;
  }
  FAIL() << "no scale";
}

// The way from the start of the map to its first tracked frame suffices for the filter to start.
TEST(ScaleRecovery, TheMotionDuringTheInitialisationCountsAsTravelled) {
  const RoadScene scene = pitchedRoad();
  for (const bool sees_start : {true, false}) {
    ScaleRecovery recovery(recoveryOptions());
    VoFrame first = scene.frame(0);
    first.status = VoStatus::kInitialising;
    if (sees_start) recovery.process(first);
    const auto output = recovery.process(scene.frame(3));
    EXPECT_EQ(output.scale.status != ScaleStatus::kUnknown, sees_start);
  }
}

TEST(ScaleRecovery, AJumpOfThePoseIsRefused) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output = run(&recovery, scene, 40);
  const MetricPose last = *output.pose;
  const Eigen::Vector3d n_c = output.scale.n_c;
  VoFrame jumped = scene.frame(40);
  jumped.T_w_c.translation().x() += 30 / kTrueScale;  // max_speed is 100 m/s, over at least 0.2 s
  output = recovery.process(jumped);
  EXPECT_FALSE(output.pose);
  EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
  EXPECT_EQ(output.scale.reason, ScaleReason::kImplausibleMotion);
  EXPECT_EQ(output.scale.n_c, n_c);
  output = recovery.process(scene.frame(41));
  ASSERT_TRUE(output.pose);
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(output.pose->distance - last.distance, 2 * 0.4 * kTrueScale, 0.1);
}

// max_speed is a speed: at a low frame rate the steps are longer.
TEST(ScaleRecovery, ALongStepInALongTimeIsNoJump) {
  const RoadScene scene = pitchedRoad();
  for (const double step_m : {25.0, 135.0}) {  // in 1.1 s
    ScaleRecovery recovery(recoveryOptions());
    run(&recovery, scene, 40);
    VoFrame next = scene.frameAt(40, 39 * scene.step + step_m / kTrueScale);
    next.stamp_ns += 1'000'000'000;
    const auto output = recovery.process(next);
    EXPECT_EQ(output.pose.has_value(), step_m < 100) << step_m;
    EXPECT_EQ(output.scale.reason == ScaleReason::kImplausibleMotion, step_m > 100) << step_m;
  }
}

// The odometry continues where it jumped to: as after a new map, with the gap bridged. The moving
// average has a scale in the new map's first frame, too. Single jumps do not add up to a new map.
TEST(ScaleRecovery, AfterALastingJumpOfThePoseANewMapStarts) {
  const RoadScene scene = pitchedRoad();
  for (const int moving_average_frames : {0, 3}) {
    SCOPED_TRACE(moving_average_frames);
    ScaleRecovery::Options options = recoveryOptions();
    options.filter.moving_average_frames = moving_average_frames;
    ScaleRecovery recovery(options);
    ScaleRecovery::Output output;
    int refused = 0, unknown = 0;
    for (std::uint32_t i = 0; i < 80; ++i) {
      VoFrame frame = scene.frame(i);
      const bool jumps = i == 34 || i == 37 || i >= 40;
      if (jumps) frame.T_w_c.translation().x() += 1000;
      output = recovery.process(frame);
      if (i < 34) continue;
      const bool is_refused = output.scale.reason == ScaleReason::kImplausibleMotion;
      EXPECT_TRUE(i >= 40 || is_refused == jumps) << i;
      refused += i >= 40 && is_refused;
      unknown += output.scale.status == ScaleStatus::kUnknown;
    }
    EXPECT_GT(refused, 1);
    EXPECT_LT(refused + unknown, 10);
    EXPECT_EQ(unknown > 0, moving_average_frames == 0);
    ASSERT_TRUE(output.pose);
    EXPECT_NEAR(output.pose->distance, kTrueScale * 0.4 * 79, 0.03 * kTrueScale * 0.4 * 79);
    EXPECT_LT(output.pose->T_o_c.translation().norm(), kTrueScale * 0.4 * 80);
  }
}

TEST(ScaleRecovery, NewMapRestartsTheScaleAndContinuesTheOdometry) {
  const RoadScene scene = pitchedRoad();
  const RoadScene other = inUnit(3, scene);
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output = run(&recovery, scene, 40);
  const MetricPose last = *output.pose;
  const Eigen::Vector3d n_c = output.scale.n_c;
  VoFrame lost = scene.frame(40);
  lost.status = VoStatus::kLost;
  output = recovery.process(lost);
  EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
  EXPECT_EQ(output.scale.reason, ScaleReason::kVoNotTracking);
  EXPECT_EQ(output.scale.n_c, n_c);
  EXPECT_FALSE(output.pose.has_value());
  bool first = true;
  for (std::uint32_t i = 41; i < 80; ++i) {
    VoFrame frame = other.frame(i);
    frame.map_id = 1;
    output = recovery.process(frame);
    if (i == 41) {
      EXPECT_EQ(output.scale.status, ScaleStatus::kUnknown);
    }
    if (output.pose && first) {
      first = false;
      // The gap is bridged, and the motion before the scale is known is appended.
      const double motion = kTrueScale * 0.4 * (i - 39);
      EXPECT_NEAR(output.pose->distance - last.distance, motion, 0.1 * motion);
      EXPECT_GT(output.pose->covariance(2, 2), last.covariance(2, 2) + 0.01);
    }
  }
  EXPECT_FALSE(first);
  EXPECT_NEAR(output.scale.scale / (kTrueScale / 3), 1, 0.01);
}

// The first map only differs in its unit of length, so the second one must not differ at all.
TEST(ScaleRecovery, ANewMapKeepsNothingInTheUnitOfTheLastOne) {
  const RoadScene scene = pitchedRoad();
  const RoadScene larger = inUnit(4, scene);
  ScaleRecovery a(recoveryOptions()), b(recoveryOptions());
  for (std::uint32_t i = 0; i < 45; ++i) {
    VoFrame frame_a = scene.frame(i), frame_b = i < 25 ? larger.frame(i) : frame_a;
    frame_a.map_id = frame_b.map_id = i < 25 ? 0 : 1;
    // The last pose of the first map lies on the road ahead of the first one of the second map.
    if (i < 25) frame_b.T_w_c.translation().z() += 26 * scene.step + 2 - 24 * larger.step;
    const cv::Mat image = roadImage(scene, scene.step * i);
    const auto output_a = a.process(frame_a, image), output_b = b.process(frame_b, image);
    if (i < 25) continue;
    EXPECT_EQ(output_a.scale.status, output_b.scale.status) << i;
    EXPECT_EQ(output_a.scale.reason, output_b.scale.reason) << i;
    EXPECT_EQ(output_a.scale.window_points, output_b.scale.window_points) << i;
    EXPECT_NEAR(output_a.scale.scale, output_b.scale.scale, 1e-9) << i;
    EXPECT_NEAR(output_a.scale.sigma, output_b.scale.sigma, 1e-9) << i;
    EXPECT_NEAR(output_a.feature_based.height, output_b.feature_based.height, 1e-9) << i;
    EXPECT_NEAR(output_a.direct.height, output_b.direct.height, 1e-9) << i;
  }
}

// The odometry has lost its map and looks for a start of the next one, of which nothing is known.
TEST(ScaleRecovery, TheScaleIsUnknownWhileANewMapInitialises) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  run(&recovery, scene, 20);
  VoFrame frame = scene.frame(20);
  frame.status = VoStatus::kLost;
  ASSERT_EQ(recovery.process(frame).scale.status, ScaleStatus::kHeld);
  frame = scene.frame(21);
  frame.status = VoStatus::kInitialising;
  frame.map_id = 1;
  const ScaleEstimate scale = recovery.process(frame).scale;
  EXPECT_EQ(scale.status, ScaleStatus::kUnknown);
  EXPECT_EQ(scale.reason, ScaleReason::kVoNotTracking);
  EXPECT_EQ(scale.scale, 0);
  EXPECT_EQ(scale.sigma, 0);
  EXPECT_EQ(scale.height, 0);
  EXPECT_EQ(scale.n_c, Eigen::Vector3d::Zero());
}

// Another odometry may leave map_id at zero in lost frames.
TEST(ScaleRecovery, ALostFrameKeepsTheMapWhateverItsNumber) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  VoFrame frame;
  for (std::uint32_t i = 0; i < 22; ++i) {
    frame = scene.frame(i);
    frame.map_id = 3;
    if (i == 20) {
      frame.status = VoStatus::kLost;
      frame.map_id = 0;
    }
    const ScaleEstimate scale = recovery.process(frame).scale;
    EXPECT_EQ(scale.status == ScaleStatus::kUnknown, i == 0) << i;
  }
}

TEST(ScaleRecovery, ATurnMakesAHeldScaleLessCertain) {
  const RoadScene scene = pitchedRoad();
  double sigma[2];
  for (const double turn : {0.0, 0.1}) {
    ScaleRecovery recovery(recoveryOptions());
    ScaleRecovery::Output output;
    for (std::uint32_t i = 0; i < 50; ++i) {
      VoFrame frame = scene.frame(i);
      if (i >= 40) {
        frame.features.clear();
        frame.T_w_c.rotate(Eigen::AngleAxisd(turn * (i - 39), Eigen::Vector3d::UnitY()));
      }
      output = recovery.process(frame);
    }
    ASSERT_EQ(output.scale.status, ScaleStatus::kHeld);
    sigma[turn > 0] = output.scale.sigma / output.scale.scale;
  }
  // A random walk of 0.05 per square root of a radian, scaled by the NIS of exact points.
  EXPECT_GT(sigma[1], 1.3 * sigma[0]);
}

TEST(ScaleRecovery, ARejectedMeasurementIsReportedAsSuch) {
  const RoadScene scene = pitchedRoad();
  RoadScene higher = scene;
  higher.height *= 1.2;
  higher.roll = 0.03;
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  for (std::uint32_t i = 0; i < 40; ++i) {
    output = recovery.process(scene.frame(i));
    EXPECT_NE(output.scale.reason, ScaleReason::kRejectedByFilter) << i;
  }
  const ScaleEstimate known = output.scale;
  const double mounting_roll = output.mounting_roll;
  int rejected = 0;
  for (std::uint32_t i = 40; i < 46; ++i) {
    VoFrame frame = higher.frame(i);
    for (TrackedFeature& feature : frame.features) feature.id += 100000;
    output = recovery.process(frame);
    if (!(output.plane.height > 1.15 * scene.height)) continue;
    ++rejected;
    EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
    EXPECT_EQ(output.scale.reason, ScaleReason::kRejectedByFilter);
    EXPECT_EQ(output.scale.scale, known.scale);
    EXPECT_NEAR(output.scale.raw_scale, kTrueScale / 1.2, 0.03);
  }
  EXPECT_GT(rejected, 0);
  EXPECT_NEAR(output.mounting_roll, mounting_roll, 1e-4);
}

// A camera that faces backwards on a hill: no road near the newest camera is visible, and the
// tangent to the visible road does not pass below it.
TEST(ScaleRecovery, ARearFacingCameraMeasuresWhereItWas) {
  constexpr double kCurvature = 0.004;  // [1 / camera height]; a radius of 410 m at 1.65 m
  RoadScene flat;
  flat.pitch = 0;
  flat.addPatch(9000, -1.5, 1.5, -70, 40, 0, 1);
  const auto elevation = [&](double z) { return 0.5 * kCurvature / flat.height * z * z; };
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  for (std::uint32_t i = 0; i < 80; ++i) {
    const double z = -flat.step * i;
    // In the camera's axes the hill is the same everywhere, because the curvature is constant.
    RoadScene scene = flat;
    for (Eigen::Vector3d& point : scene.points) point.y() = elevation(point.z() - z);
    VoFrame frame = scene.frameAt(i, z);
    const double slope = kCurvature / flat.height * z;  // y points down
    frame.T_w_c.translation().y() = elevation(z);
    frame.T_w_c.linear() = Eigen::AngleAxisd(-slope, Eigen::Vector3d::UnitX()).toRotationMatrix();
    output = recovery.process(frame);
  }
  ASSERT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.01);
  // The camera that was above the measured road is nearer to it than the newest one.
  ASSERT_FALSE(output.ground_points_c.empty());
  double ahead = 0;
  for (const Eigen::Vector3f& p : output.ground_points_c) {
    EXPECT_NEAR(p.y(), flat.height + elevation(p.z()), 0.01 * flat.height);
    ahead += p.z() / static_cast<double>(output.ground_points_c.size());
  }
  EXPECT_LT(output.feature_based.road_distance, 0.5 * ahead);
  // In the axes of the newest camera, where the road rises or falls by `slope`.
  const double slope = kCurvature / flat.height * ahead;
  EXPECT_NEAR(output.plane.n_c.z(), slope, 0.3 * std::abs(slope));
}

// The newest camera is pitched against the road, the one above the measured road is not.
TEST(ScaleRecovery, ARearFacingCameraUsesTheNormalWhereItWas) {
  RoadScene scene;
  scene.addPatch(4000, -1.5, 1.5, -40, 40, 0, 1);
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  for (std::uint32_t i = 0; i <= 40; ++i) {
    scene.pitch = i < 40 ? 0 : 0.1;
    const double z = -scene.step * i;
    VoFrame frame = scene.frameAt(i, z);
    frame.T_w_c = Eigen::Isometry3d(scene.rotation());  // world axes are road axes
    frame.T_w_c.translation().z() = z;
    output = recovery.process(frame);
  }
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(output.plane.height / scene.height, 1, 0.01);
  EXPECT_NEAR((output.plane.n_c - scene.normal()).norm(), 0, 0.01);
}

TEST(ScaleRecovery, DirectMeasurementsReplaceMissingPoints) {
  RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  int first_known = -1;
  for (std::uint32_t i = 0; i < 25; ++i) {
    VoFrame frame = scene.frame(i);
    frame.features.resize(5);  // too few for a plane
    output = recovery.process(frame, roadImage(scene, scene.step * i));
    EXPECT_EQ(output.feature_based.height, 0);
    if (first_known < 0 && output.scale.status == ScaleStatus::kOk)
      first_known = static_cast<int>(i);
  }
  EXPECT_GT(first_known, 0);
  EXPECT_LT(first_known, 12);
  EXPECT_EQ(output.scale.reason, ScaleReason::kNone);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.006);
  EXPECT_NEAR(output.direct.height / 0.7, 1, 0.01);
  EXPECT_GT(output.correlation, 0.8);
}

// Of two contradicting measurements the filter accepts the one that agrees with its state. The
// other one must not determine the reported plane.
TEST(ScaleRecovery, TheReportedPlaneIsTheAcceptedOne) {
  const RoadScene scene = pitchedRoad();
  RoadScene higher = scene;
  higher.height *= 1.2;
  for (const bool direct_is_wrong : {true, false}) {
    ScaleRecovery recovery(recoveryOptions());
    ScaleRecovery::Output output = run(&recovery, scene, 40, true);
    ASSERT_EQ(output.scale.status, ScaleStatus::kOk);
    // Of two accepted ones it is the direct one, which is more precise.
    ASSERT_GT(output.feature_based.height, 0);
    EXPECT_EQ(output.plane.height, output.direct.height);
    const RoadScene& imaged = direct_is_wrong ? higher : scene;
    const RoadScene& tracked = direct_is_wrong ? scene : higher;
    int contradictions = 0;
    for (std::uint32_t i = 40; i < 50; ++i) {
      VoFrame frame = tracked.frame(i);
      for (TrackedFeature& feature : frame.features) feature.id += direct_is_wrong ? 0 : 100000;
      output = recovery.process(frame, roadImage(imaged, scene.step * i));
      const double rejected = direct_is_wrong ? output.direct.height : output.feature_based.height;
      const double accepted = direct_is_wrong ? output.feature_based.height : output.direct.height;
      if (!(rejected > 1.15 * scene.height) || accepted == 0) continue;
      ++contradictions;
      EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
      EXPECT_NEAR(output.plane.height / scene.height, 1, 0.02);
      EXPECT_NEAR(output.scale.raw_scale / kTrueScale, 1, 0.02);
    }
    EXPECT_GT(contradictions, 2);
  }
}

TEST(ScaleRecovery, WithoutImagesOrRefineItIsFeatureBased) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery::Options o = recoveryOptions();
  o.refine = false;
  ScaleRecovery without(recoveryOptions()), disabled(o);
  for (std::uint32_t i = 0; i < 12; ++i) {
    const auto a = without.process(scene.frame(i));
    const auto b = disabled.process(scene.frame(i), roadImage(scene, scene.step * i));
    EXPECT_EQ(std::memcmp(&a.scale.scale, &b.scale.scale, sizeof(double)), 0);
    EXPECT_EQ(std::memcmp(&a.scale.sigma, &b.scale.sigma, sizeof(double)), 0);
    EXPECT_EQ(b.direct.height, 0);
  }
}

TEST(ScaleRecovery, AnImageOfAnotherSizeIsRefused) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  EXPECT_THROW(recovery.process(scene.frame(0), cv::Mat(10, 10, CV_8U)), OptionError);
  EXPECT_THROW(recovery.process(scene.frame(0), cv::Mat(188, 620, CV_8UC3)), OptionError);
  const cv::Mat image = roadImage(scene, 0);
  EXPECT_THROW(recovery.process(scene.frame(0), image, cv::Mat(10, 10, CV_8U)), OptionError);
}

TEST(ScaleRecovery, IsDeterministicAndResetRestoresTheInitialState) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery a(recoveryOptions()), b(recoveryOptions());
  for (std::uint32_t i = 0; i < 30; ++i) b.process(scene.frame(i + 100));
  b.reset();
  for (std::uint32_t i = 0; i < 50; ++i) {
    const auto output_a = a.process(scene.frame(i)), output_b = b.process(scene.frame(i));
    EXPECT_EQ(std::memcmp(&output_a.scale.raw_scale, &output_b.scale.raw_scale, sizeof(double)), 0);
    EXPECT_EQ(std::memcmp(&output_a.scale.scale, &output_b.scale.scale, sizeof(double)), 0);
    EXPECT_EQ(output_a.scale.n_c, output_b.scale.n_c);
    EXPECT_EQ(output_a.ground_feature_ids, output_b.ground_feature_ids);
    ASSERT_EQ(output_a.pose.has_value(), output_b.pose.has_value());
    if (output_a.pose) {
      EXPECT_EQ(output_a.pose->covariance, output_b.pose->covariance);
    }
  }
}

TEST(ScaleRecovery, PaperLiteralRuns) {
  RoadScene scene = pitchedRoad();
  scene.depth_noise = 0.002;
  ScaleRecovery::Options o = recoveryOptions();
  o.paper_literal = true;
  ScaleRecovery recovery(o);
  ScaleRecovery::Output output = run(&recovery, scene, 60);
  ASSERT_NE(output.scale.status, ScaleStatus::kUnknown);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.03);
}

TEST(ScaleRecovery, BadOptionsAreNamed) {
  using Options = ScaleRecovery::Options;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  struct Case {
    const char* name;
    void (*set)(Options*);
  };
  const Case kCases[] = {
      {"camera_height", [](Options* o) { *o = {}; }},  // required: no default
      {"camera_height", [](Options* o) { o->camera_height = -1; }},
      {"camera_height", [](Options* o) { o->camera_height = kNan; }},
      {"gpe/min_points", [](Options* o) { o->gpe.min_points = 2; }},
      {"fit/roughness_heights", [](Options* o) { o->gpa.fit.roughness_heights = 0; }},
      {"filter/gate_sigma", [](Options* o) { o->filter.gate_sigma = 0; }},
      {"mounting/chord_length_heights", [](Options* o) { o->mounting.chord_length_heights = 0; }},
      {"trajectory/direction_sigma", [](Options* o) { o->trajectory.direction_sigma = kNan; }},
      // Two options that contradict each other.
      {"gpe/max_half_width_heights", [](Options* o) { o->gpe.max_half_width_heights = 0.6; }},
      {"gpe/max_ahead_heights",
       [](Options* o) { o->gpe.max_ahead_heights = 0.5 * o->gpe.min_ahead_heights; }},
      {"gpa/min_frames", [](Options* o) { o->gpa.min_frames = o->gpa.max_frames + 1; }},
      {"direct/max_ahead_heights", [](Options* o) { o->direct.max_ahead_heights = 1; }}};
  for (const Case& each : kCases) {
    Options options = recoveryOptions();
    each.set(&options);
    try {
      ScaleRecovery recovery(options);
      ADD_FAILURE() << each.name;
    } catch (const OptionError& error) {
      EXPECT_EQ(std::string(error.what()).find(each.name), 0u) << error.what();
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo
