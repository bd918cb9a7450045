#include "ground_scale_vo/scale/scale_recovery.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "support/expect_throws.hpp"
#include "support/road_image.hpp"

namespace gsv {
namespace {

RoadScene pitchedRoad() {
  RoadScene scene;
  scene.pitch = 0.03;
  scene.addPatch(6000, -2.5, 2.5, 0, 60, 0, 1);
  scene.depth_noise = 0.02;
  return scene;
}

const double kTrueScale = 1.65 / RoadScene().height;  // [m per VO unit]

VoFrame with(VoStatus status, Continuity continuity, VoFrame frame) {
  frame.status = status;
  frame.continuity = continuity;
  return frame;
}

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
  bool was_known = false;
  for (std::uint32_t i = 0; i < 80; ++i) {
    output = recovery.process(scene.frame(i));
    const bool known = output.scale.status != ScaleStatus::kUnknown;
    EXPECT_EQ(output.pose.has_value(), known);
    if (!known) {
      EXPECT_LE(i * scene.step, 2 * scene.height);
      EXPECT_EQ(output.scale.scale, 0);
      EXPECT_GT(output.scale.raw_scale, 0);  // measured, before the filter may start
      EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.05);
    } else if (!was_known) {
      was_known = true;
      EXPECT_NEAR(output.pose->distance, kTrueScale * scene.step * i, 0.1 * output.pose->distance);
      EXPECT_LT(std::abs(output.scale.scale - kTrueScale), 2 * output.scale.sigma);
    }
  }
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_EQ(output.scale.measurement, MeasurementStatus::kMeasured);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.01);
  EXPECT_LT(std::abs(output.scale.scale - kTrueScale), 3 * output.scale.sigma);
  EXPECT_LT(output.scale.sigma / kTrueScale, 0.03);
  EXPECT_NEAR(output.scale.height, 0.7, 0.007);
  EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.01);
  EXPECT_NEAR(output.mounting_pitch, 0.03, 0.002);
  EXPECT_NEAR(output.pose->distance, kTrueScale * 0.4 * 79, 0.015 * kTrueScale * 0.4 * 79);
  EXPECT_GT(output.ground_feature_ids.size(), 50u);
}

// A camera that faces backwards and vibrates: the height belongs to an earlier camera of the path,
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
class ScaleRecoveryMounting : public testing::TestWithParam<std::tuple<double, double, double>> {};

TEST_P(ScaleRecoveryMounting, FeaturesOrDirectMeasurementsAloneGiveTheScale) {
  RoadScene scene;
  std::tie(scene.pitch, scene.roll, scene.yaw) = GetParam();
  scene.camera = {640, 360, 360, 360, 320, 180};
  for (const bool is_direct : {false, true}) {
    SCOPED_TRACE(is_direct);
    scene.points.clear();
    scene.addPatch(is_direct ? 600 : 8000, -6, 6, -6, 40, 0, 1);
    scene.depth_noise = is_direct ? 0 : 0.02;
    ScaleRecovery::Options options = recoveryOptions();
    if (is_direct) options.gpe.min_points = 1000000;
    ScaleRecovery recovery(options);
    const ScaleRecovery::Output output = run(&recovery, scene, is_direct ? 24 : 80, is_direct);
    ASSERT_NE(output.scale.status, ScaleStatus::kUnknown);
    EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.015);
    EXPECT_NEAR((output.scale.n_c - scene.normal()).norm(), 0, 0.02);
    if (is_direct) {
      EXPECT_EQ(output.feature_based.plane.height, 0);
      EXPECT_NEAR(output.direct.plane.height / scene.height, 1, 0.02);
      EXPECT_GT(output.direct.correlation, 0.8);
      continue;
    }
    const Eigen::Vector3d mounting_n_c = roadNormal(output.mounting_pitch, output.mounting_roll);
    EXPECT_NEAR((mounting_n_c - scene.normal()).norm(), 0, 0.02);
    EXPECT_GT(output.mounting_sigma, 0);
    EXPECT_LT(output.mounting_sigma, 0.03);
  }
}

INSTANTIATE_TEST_SUITE_P(Mountings, ScaleRecoveryMounting,
                         testing::Values(std::tuple(-0.06, -0.26, 0.0), std::tuple(0.35, 0.0, 0.0),
                                         std::tuple(0.0, 0.0, 0.25 * M_PI),
                                         std::tuple(0.1, 0.1, -0.5 * M_PI)));

TEST(ScaleRecovery, HeldWithReasonWhenTheRoadIsHidden) {
  const RoadScene scene = pitchedRoad();
  RoadScene pitched = scene;  // by the vehicle, against the road
  pitched.pitch += 0.05;
  double sigma[2];
  for (const double turn : {0.0, 0.1}) {  // yaw between frames [rad]
    ScaleRecovery recovery(recoveryOptions());
    ScaleRecovery::Output output = run(&recovery, scene, 40);
    ASSERT_EQ(output.scale.status, ScaleStatus::kOk);
    const ScaleEstimate known = output.scale;
    const double mounting_pitch = output.mounting_pitch;
    for (std::uint32_t i = 40; i < 60; ++i) {
      VoFrame frame = scene.frame(i);
      frame.features.clear();
      frame.T_w_c.linear() = scene.rotation().transpose() * pitched.rotation();
      frame.T_w_c.rotate(Eigen::AngleAxisd(turn * (i - 39), Eigen::Vector3d::UnitY()));
      output = recovery.process(frame);
      EXPECT_EQ(output.scale.measurement, MeasurementStatus::kTooFewTriangles);
    }
    if (turn == 0) {  // the normal follows the direction of motion
      EXPECT_NEAR((output.scale.n_c - pitched.normal()).norm(), 0, 0.01);
    }
    EXPECT_EQ(output.mounting_pitch, mounting_pitch) << "nothing of the road is seen";
    EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
    EXPECT_EQ(output.scale.scale, known.scale);
    EXPECT_GT(output.scale.sigma, 1.2 * known.sigma);
    EXPECT_EQ(output.scale.raw_scale, 0);
    EXPECT_TRUE(output.pose.has_value());
    sigma[turn > 0] = output.scale.sigma;
  }
  EXPECT_GT(sigma[1], 1.3 * sigma[0]);
}

// Each step of the slow motion alone is shorter than standstill_distance_heights, three are longer:
// at a high frame rate all motion is slow.
TEST(ScaleRecovery, StandstillHoldsTheScaleAndSlowMotionAddsUp) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  const ScaleRecovery::Output moving = run(&recovery, scene, 40);
  ScaleRecovery::Output still;
  for (std::uint32_t i = 40; i < 100; ++i) {
    VoFrame frame = scene.frameAt(i, 39 * scene.step + 0.0005 * (i % 3));
    frame.T_w_c.rotate(Eigen::AngleAxisd(0.01 * (i % 3), Eigen::Vector3d::UnitY()));
    still = recovery.process(frame);
    EXPECT_EQ(still.scale.status, ScaleStatus::kHeld);
    EXPECT_EQ(still.scale.measurement, MeasurementStatus::kStandstill);
    EXPECT_EQ(still.scale.scale, moving.scale.scale);
    EXPECT_EQ(still.scale.sigma, moving.scale.sigma);
    EXPECT_EQ(still.scale.n_c, moving.scale.n_c);
  }
  EXPECT_NEAR(still.pose->distance, moving.pose->distance, 0.15);
  const double slow_step =
      0.4 * ScaleRecovery::Options().standstill_distance_heights * scene.height;
  int measured = 0;
  for (std::uint32_t i = 100; i < 130; ++i) {
    const auto slow = recovery.process(scene.frameAt(i, 39 * scene.step + slow_step * (i - 99)));
    measured += slow.scale.status == ScaleStatus::kOk;
  }
  EXPECT_NEAR(measured, 10, 1);
}

// The way from the start of the map to its first tracked frame suffices for the filter to start.
TEST(ScaleRecovery, TheMotionDuringTheInitialisationCountsAsTravelled) {
  const RoadScene scene = pitchedRoad();
  for (const bool sees_start : {true, false}) {
    ScaleRecovery recovery(recoveryOptions());
    if (sees_start) {
      recovery.process(with(VoStatus::kInitialising, Continuity::kSameMap, scene.frame(0)));
    }
    const auto output = recovery.process(scene.frame(3));
    EXPECT_EQ(output.scale.status != ScaleStatus::kUnknown, sees_start);
  }
}

TEST(ScaleRecovery, WhileTheCameraIsZoomedThereIsNoScale) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery recovery(recoveryOptions());
  ASSERT_TRUE(run(&recovery, scene, 40).pose);
  for (std::uint32_t i = 40; i < 90; ++i) {
    SCOPED_TRACE(i);
    VoFrame frame = scene.frame(i);
    const bool is_zoomed = i < 60;
    frame.zoom = is_zoomed ? 1.2 : 1;
    frame.map_id = is_zoomed ? 1 : 2;
    if (i == 40 || i == 60) frame.continuity = Continuity::kNewMap;
    const ScaleRecovery::Output output = recovery.process(frame);
    EXPECT_EQ(output.scale.measurement == MeasurementStatus::kZoomed, is_zoomed);
    if (is_zoomed) {
      EXPECT_EQ(output.scale.status, ScaleStatus::kUnknown);
      EXPECT_FALSE(output.pose);
    } else if (i > 65) {
      ASSERT_TRUE(output.pose);
      EXPECT_NEAR(output.scale.scale, kTrueScale, 0.02 * kTrueScale);
    }
  }
}

// The highest speed is 100 m/s, over at least 0.2 s.
TEST(ScaleRecovery, AJumpOfThePoseIsRefusedButNotALongStepInALongTime) {
  struct Case {
    double step_m, extra_s;
    bool is_jump;
  };
  const RoadScene scene = pitchedRoad();
  for (const Case& each : {Case{30, 0, true}, Case{25, 1, false}, Case{135, 1, true}}) {
    SCOPED_TRACE(each.step_m);
    ScaleRecovery recovery(recoveryOptions());
    ScaleRecovery::Output output = run(&recovery, scene, 40);
    const MetricPose last = *output.pose;
    const Eigen::Vector3d n_c = output.scale.n_c;
    VoFrame next = scene.frameAt(40, 39 * scene.step + each.step_m / kTrueScale);
    next.stamp_ns += static_cast<std::int64_t>(1e9 * each.extra_s);
    output = recovery.process(next);
    EXPECT_EQ(output.pose.has_value(), !each.is_jump);
    EXPECT_EQ(output.scale.measurement == MeasurementStatus::kImplausibleMotion, each.is_jump);
    if (!each.is_jump) continue;
    EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
    EXPECT_EQ(output.scale.n_c, n_c);
    VoFrame back = scene.frame(41);
    back.stamp_ns = next.stamp_ns + 100'000'000;
    output = recovery.process(back);
    ASSERT_TRUE(output.pose);
    EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
    EXPECT_NEAR(output.pose->distance - last.distance, 2 * 0.4 * kTrueScale, 0.1);
  }
}

// The odometry continues where it jumped to: as after a new map, with the gap bridged. The moving
// average has a scale in the new map's first frame, too. Single jumps do not add up to a new map.
TEST(ScaleRecovery, AfterALastingJumpOfThePoseANewMapStarts) {
  const RoadScene scene = pitchedRoad();
  for (const int moving_average_frames : {0, 3}) {
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
      const bool is_refused = output.scale.measurement == MeasurementStatus::kImplausibleMotion;
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

// A jump that ends while the scale of the map that started after it is not known yet: for how many
// frames that is depends on the speed.
TEST(ScaleRecovery, TheEndOfAJumpOfThePoseIsNoMotion) {
  for (const double step : {0.4, 0.1}) {
    RoadScene scene = pitchedRoad();
    scene.step = step;
    for (std::uint32_t duration = 1; duration <= 12; ++duration) {
      SCOPED_TRACE(testing::Message() << "step " << step << ", " << duration << " frames");
      ScaleRecovery recovery(recoveryOptions());
      ScaleRecovery::Output output;
      for (std::uint32_t i = 0; i < 90; ++i) {
        VoFrame frame = scene.frame(i);
        if (i >= 40 && i < 40 + duration) frame.T_w_c.translation().x() += 70 / kTrueScale;
        output = recovery.process(frame);
      }
      ASSERT_TRUE(output.pose);
      const Eigen::Vector3d error =
          output.pose->T_o_c.translation() - kTrueScale * scene.frame(89).T_w_c.translation();
      EXPECT_LT(error.norm(), 3 * std::sqrt(output.pose->covariance.topLeftCorner<3, 3>().trace()));
      EXPECT_LT(error.norm(), 3);
    }
  }
}

// Another odometry that starts again in another unit of length, without a new map_id.
TEST(ScaleRecovery, AfterAChangeOfTheUnitTheScaleIsFoundAgain) {
  const RoadScene scene = pitchedRoad();
  const RoadScene other = inUnit(50, scene);
  ScaleRecovery recovery(recoveryOptions());
  run(&recovery, scene, 40);
  ScaleRecovery::Output output;
  for (std::uint32_t i = 40; i < 80; ++i) output = recovery.process(other.frame(i));
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(output.scale.scale / (kTrueScale / 50), 1, 0.02);
}

TEST(ScaleRecovery, AnotherLensMakesTheScaleUncertain) {
  const RoadScene scene = pitchedRoad();
  const auto sigmaAfter = [&](Continuity continuity) {
    ScaleRecovery recovery(recoveryOptions());
    run(&recovery, scene, 60);
    return recovery.process(with(VoStatus::kTracking, continuity, scene.frame(60))).scale.sigma;
  };
  EXPECT_GT(sigmaAfter(Continuity::kOtherLens), 1.08 * sigmaAfter(Continuity::kSameMap));
}

TEST(ScaleRecovery, NewMapRestartsTheScaleAndContinuesTheOdometry) {
  const RoadScene scene = pitchedRoad();
  const RoadScene other = inUnit(3, scene);
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output = run(&recovery, scene, 40);
  const Eigen::Vector3d n_c = output.scale.n_c;
  // A lost frame belongs to no map.
  output = recovery.process(with(VoStatus::kLost, Continuity::kNewMap, scene.frame(40)));
  EXPECT_EQ(output.scale.status, ScaleStatus::kHeld);
  EXPECT_EQ(output.scale.measurement, MeasurementStatus::kVoNotTracking);
  EXPECT_EQ(output.scale.n_c, n_c);
  EXPECT_FALSE(output.pose.has_value());
  output = recovery.process(scene.frame(41));
  EXPECT_EQ(output.scale.status, ScaleStatus::kOk);
  const MetricPose last = *output.pose;
  // The odometry looks for a start of the next map, of which nothing is known.
  output = recovery.process(with(VoStatus::kInitialising, Continuity::kNewMap, scene.frame(42)));
  EXPECT_EQ(output.scale.status, ScaleStatus::kUnknown);
  EXPECT_EQ(output.scale.measurement, MeasurementStatus::kVoNotTracking);
  EXPECT_EQ(output.scale.scale, 0);
  EXPECT_EQ(output.scale.sigma, 0);
  EXPECT_EQ(output.scale.height, 0);
  EXPECT_EQ(output.scale.n_c, Eigen::Vector3d::Zero());
  bool has_pose = false;
  for (std::uint32_t i = 43; i < 80; ++i) {
    VoFrame frame = other.frame(i);
    if (i == 43) frame.continuity = Continuity::kNewMap;  // its first image was not seen
    output = recovery.process(frame);
    EXPECT_TRUE(i > 43 || output.scale.status == ScaleStatus::kUnknown);
    if (!output.pose || has_pose) continue;
    has_pose = true;
    // The gap is bridged, and the motion before the scale is known is appended.
    const double motion = kTrueScale * 0.4 * (i - 41);
    EXPECT_NEAR(output.pose->distance - last.distance, motion, 0.1 * motion);
    EXPECT_GT(output.pose->covariance(2, 2), last.covariance(2, 2) + 0.01);
  }
  EXPECT_TRUE(has_pose);
  EXPECT_NEAR(output.scale.scale / (kTrueScale / 3), 1, 0.01);
}

// The first map only differs in its unit of length, so the second one must not differ at all.
TEST(ScaleRecovery, ANewMapKeepsNothingInTheUnitOfTheLastOne) {
  const RoadScene scene = pitchedRoad();
  const RoadScene larger = inUnit(4, scene);
  ScaleRecovery a(recoveryOptions()), b(recoveryOptions());
  for (std::uint32_t i = 0; i < 45; ++i) {
    VoFrame frame_a = scene.frame(i), frame_b = i < 25 ? larger.frame(i) : frame_a;
    if (i == 25) frame_a.continuity = frame_b.continuity = Continuity::kNewMap;
    // The last pose of the first map lies on the road ahead of the first one of the second map.
    if (i < 25) frame_b.T_w_c.translation().z() += 26 * scene.step + 2 - 24 * larger.step;
    const cv::Mat image = roadImage(scene, scene.step * i);
    const auto output_a = a.process(frame_a, image), output_b = b.process(frame_b, image);
    if (i < 25) continue;
    SCOPED_TRACE(i);
    const ScaleEstimate &scale_a = output_a.scale, &scale_b = output_b.scale;
    EXPECT_EQ(scale_a.status, scale_b.status);
    EXPECT_EQ(scale_a.measurement, scale_b.measurement);
    EXPECT_EQ(scale_a.window_points, scale_b.window_points);
    EXPECT_NEAR(scale_a.scale, scale_b.scale, 1e-9);
    EXPECT_NEAR(scale_a.sigma, scale_b.sigma, 1e-9);
    EXPECT_NEAR(output_a.feature_based.plane.height, output_b.feature_based.plane.height, 1e-9);
    EXPECT_NEAR(output_a.direct.plane.height, output_b.direct.plane.height, 1e-9);
  }
}

// A camera that faces backwards on a hill: no road near the newest camera is visible, and the
// tangent to the visible road does not pass below it. The newest camera is pitched against the
// road, the one above the measured road is not.
TEST(ScaleRecovery, ARearFacingCameraMeasuresWhereItWas) {
  constexpr double kCurvature = 0.004;  // [1 / camera height]; a radius of 410 m at 1.65 m
  RoadScene flat;
  flat.pitch = 0;
  flat.addPatch(9000, -1.5, 1.5, -70, 40, 0, 1);
  const auto elevation = [&](double z) { return 0.5 * kCurvature / flat.height * z * z; };
  const auto slope = [&](double z) { return kCurvature / flat.height * z; };  // y points down
  ScaleRecovery recovery(recoveryOptions());
  ScaleRecovery::Output output;
  Eigen::Matrix3d R_r_c;
  for (std::uint32_t i = 0; i < 80; ++i) {
    const double z = -flat.step * i;
    // In the camera's axes the hill is the same everywhere, because the curvature is constant.
    RoadScene scene = flat;
    scene.pitch = i < 79 ? 0 : 0.1;
    R_r_c = scene.rotation();
    for (Eigen::Vector3d& point : scene.points) point.y() = elevation(point.z() - z);
    VoFrame frame = scene.frameAt(i, z);
    frame.T_w_c.translation() = Eigen::Vector3d(0, elevation(z), z);
    frame.T_w_c.linear() = Eigen::AngleAxisd(-slope(z), Eigen::Vector3d::UnitX()) * R_r_c;
    output = recovery.process(frame);
  }
  ASSERT_EQ(output.scale.status, ScaleStatus::kOk);
  EXPECT_NEAR(output.scale.scale / kTrueScale, 1, 0.01);
  EXPECT_NEAR(output.plane.height / flat.height, 1, 0.01);
  // The camera that was above the measured road is nearer to it than the newest one.
  ASSERT_FALSE(output.ground_points_c.empty());
  double ahead = 0;
  for (const Eigen::Vector3f& p_c : output.ground_points_c) {
    const Eigen::Vector3d p_r = R_r_c * p_c.cast<double>();
    EXPECT_NEAR(p_r.y(), flat.height + elevation(p_r.z()), 0.01 * flat.height);
    ahead += p_r.z() / static_cast<double>(output.ground_points_c.size());
  }
  EXPECT_LT(output.feature_based.road_distance, 0.5 * ahead);
  // In the axes of the newest camera, where the road rises or falls.
  EXPECT_NEAR((R_r_c * output.plane.n_c).z(), slope(ahead), 0.3 * std::abs(slope(ahead)));
}

// Of two contradicting measurements the filter accepts the one that agrees with its state. The
// other one must not determine the reported plane.
TEST(ScaleRecovery, AContradictingMeasurementIsRejected) {
  struct Case {
    bool has_images, direct_is_wrong;
  };
  const RoadScene scene = pitchedRoad();
  for (const Case& each : {Case{true, true}, Case{true, false}, Case{false, false}}) {
    RoadScene higher = scene;
    higher.height *= 1.2;
    higher.roll = each.has_images ? 0 : 0.03;
    ScaleRecovery recovery(recoveryOptions());
    ScaleRecovery::Output output = run(&recovery, scene, 40, each.has_images);
    ASSERT_EQ(output.scale.status, ScaleStatus::kOk);
    const ScaleEstimate known = output.scale;
    const double mounting_roll = output.mounting_roll;
    // Of two accepted ones it is the direct one, which is more precise.
    ASSERT_GT(output.feature_based.plane.height, 0);
    EXPECT_EQ(output.plane.height == output.direct.plane.height, each.has_images);
    const RoadScene& imaged = each.direct_is_wrong ? higher : scene;
    const RoadScene& tracked = each.direct_is_wrong ? scene : higher;
    int contradictions = 0;
    for (std::uint32_t i = 40; i < 46; ++i) {
      VoFrame frame = tracked.frame(i);
      for (TrackedFeature& feature : frame.features) {
        feature.id += each.direct_is_wrong ? 0 : 100000;
      }
      output =
          recovery.process(frame, each.has_images ? roadImage(imaged, scene.step * i) : cv::Mat());
      double rejected = output.feature_based.plane.height, accepted = output.direct.plane.height;
      if (each.direct_is_wrong) std::swap(rejected, accepted);
      if (!(rejected > 1.15 * scene.height) || (accepted > 0) != each.has_images) continue;
      ++contradictions;
      EXPECT_EQ(output.scale.status, each.has_images ? ScaleStatus::kOk : ScaleStatus::kHeld);
      const double height = each.has_images ? scene.height : higher.height;
      EXPECT_NEAR(output.plane.height / height, 1, 0.025);
      EXPECT_NEAR(output.scale.raw_scale, 1.65 / height, 0.025 * kTrueScale);
      if (each.has_images) continue;
      EXPECT_EQ(output.scale.measurement, MeasurementStatus::kRejectedByFilter);
      EXPECT_EQ(output.scale.scale, known.scale);
      EXPECT_NEAR(output.mounting_roll, mounting_roll, 1e-4);
    }
    EXPECT_GT(contradictions, 1);
  }
}

TEST(ScaleRecovery, WithoutImagesOrRefineItIsFeatureBased) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery::Options options = recoveryOptions();
  options.refine = false;
  ScaleRecovery without(recoveryOptions()), disabled(options);
  const auto a = run(&without, scene, 12), b = run(&disabled, scene, 12, true);
  EXPECT_EQ(a.scale.scale, b.scale.scale);
  EXPECT_EQ(a.scale.sigma, b.scale.sigma);
  EXPECT_EQ(b.direct.plane.height, 0);
}

TEST(ScaleRecovery, IsDeterministicAndANewTrajectoryRestoresTheInitialState) {
  const RoadScene scene = pitchedRoad();
  ScaleRecovery a(recoveryOptions()), b(recoveryOptions());
  for (std::uint32_t i = 0; i < 30; ++i) b.process(scene.frame(i + 100));
  b.process(with(VoStatus::kLost, Continuity::kNewTrajectory, scene.frame(0)));
  const auto output_a = run(&a, scene, 50), output_b = run(&b, scene, 50);
  EXPECT_EQ(output_a.scale.raw_scale, output_b.scale.raw_scale);
  EXPECT_EQ(output_a.scale.scale, output_b.scale.scale);
  EXPECT_EQ(output_a.scale.n_c, output_b.scale.n_c);
  EXPECT_EQ(output_a.ground_feature_ids, output_b.ground_feature_ids);
  EXPECT_EQ(output_a.pose->T_o_c.matrix(), output_b.pose->T_o_c.matrix());
  EXPECT_EQ(output_a.pose->covariance, output_b.pose->covariance);
}

TEST(ScaleRecovery, RefusesImagesOfAnotherSizeAndOptionsThatContradictEachOther) {
  const VoFrame frame = pitchedRoad().frame(0);
  const cv::Mat small(10, 10, CV_8U);
  ScaleRecovery recovery(recoveryOptions());
  EXPECT_THROW(recovery.process(frame, small), OptionError);
  EXPECT_THROW(recovery.process(frame, cv::Mat(188, 620, CV_8UC3)), OptionError);
  EXPECT_THROW(recovery.process(frame, cv::Mat(188, 620, CV_8U), small), OptionError);
  ScaleRecovery::Options narrow = recoveryOptions(), near = narrow;
  narrow.gpe.max_half_width_heights = 0.6;
  near.direct.max_ahead_heights = 1;
  expectThrows<OptionError>([&] { ScaleRecovery recovery(narrow); }, "gpe/max_half_width_heights");
  expectThrows<OptionError>([&] { ScaleRecovery recovery(near); }, "direct/max_ahead_heights");
}

}  // namespace
}  // namespace gsv
