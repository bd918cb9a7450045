#include "scale/drive_smoother.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "support/road_scene.hpp"

namespace gsv {
namespace {

TEST(DriveSmoother, IsEmptyUnlessTheDriveIsRecorded) {
  ScaleRecovery recovery(recoveryOptions());
  recovery.process(RoadScene().frame(0));
  EXPECT_TRUE(recovery.smoothed().empty());
}

TEST(DriveSmoother, AMovingAverageIsRefused) {
  ScaleRecovery::Options options = recoveryOptions();
  options.record = true;
  options.filter.moving_average_frames = 10;
  EXPECT_THROW(ScaleRecovery(options).smoothed(), OptionError);
}

/// As the scale filter sees it: heights with a given error.
struct Filtered {
  ScaleFilter filter{{}, {1.65, 0, 0}};
  DriveSmoother smoother;
  std::vector<double> scales, sigmas;
  std::uint32_t frames = 0;

  /// A frame after `step` [VO units]; height: measured, 0: none.
  void add(double step, double height, double sigma = 0.02, double angle = 0,
           Continuity continuity = Continuity::kSameMap) {
    if (continuity >= Continuity::kNewMap) {
      filter.startMap();
      smoother.startMap();
      at = 0;
    }
    filter.predict(step, angle, 0.003);
    if (height > 0) filter.update(height, sigma * height, 3 * height);
    smoother.addStep(filter);
    VoFrame frame;
    frame.sequence = frames++;
    frame.stamp_ns = 100'000'000ll * frame.sequence;
    frame.status = VoStatus::kTracking;
    frame.continuity = continuity;
    frame.T_w_c.translation().z() = at += step;
    ScaleEstimate scale;
    scale.status = filter.known() ? ScaleStatus::kOk : ScaleStatus::kUnknown;
    scale.scale = filter.scale();
    scale.sigma = filter.scaleSigma();
    smoother.addFrame(frame, continuity, scale, SpeedTrack(0));
    scales.push_back(filter.scale());
    sigmas.push_back(filter.scaleSigma());
  }
  std::vector<ScaleRecovery::Smoothed> smoothed() const {
    return smoother.smoothed(recoveryOptions());
  }
  double at = 0;
};

TEST(DriveSmoother, ALaterMeasurementCorrectsEarlierFramesAndTheLastOneIsTheFilters) {
  Filtered drive;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.03);
  for (int i = 0; i < 200; ++i) drive.add(1, std::exp(noise(random)), 0.03);
  const auto smoothed = drive.smoothed();
  ASSERT_EQ(smoothed.size(), 200u);
  double filtered_squares = 0, smoothed_squares = 0;
  for (std::size_t i = 0; i < 200; ++i) {
    ASSERT_NE(smoothed[i].scale.status, ScaleStatus::kUnknown);
    ASSERT_TRUE(smoothed[i].pose);
    if (drive.scales[i] == 0) continue;
    filtered_squares += std::pow(drive.scales[i] / 1.65 - 1, 2);
    smoothed_squares += std::pow(smoothed[i].scale.scale / 1.65 - 1, 2);
    EXPECT_LE(smoothed[i].scale.sigma, 1.0001 * drive.sigmas[i]) << i;
  }
  EXPECT_LT(smoothed_squares, 0.5 * filtered_squares);
  EXPECT_NEAR(smoothed.back().scale.scale, drive.scales.back(), 1e-9);
  EXPECT_NEAR(smoothed.back().scale.sigma, drive.sigmas.back(), 1e-9);
  EXPECT_NEAR(smoothed.back().pose->distance, 1.65 * 199, 0.01 * 1.65 * 199);
}

// The first metres of a map have no scale of their own.
TEST(DriveSmoother, EveryTrackedFrameOfAMapWithAMeasurementHasAPose) {
  Filtered drive;
  for (int i = 0; i < 20; ++i) drive.add(1, 0);
  for (int i = 0; i < 20; ++i) drive.add(1, 1);
  ASSERT_EQ(drive.scales[19], 0);
  for (int i = 0; i < 20; ++i)
    drive.add(1, 0, 0, 0, i ? Continuity::kSameMap : Continuity::kNewMap);
  const auto smoothed = drive.smoothed();
  for (std::size_t i = 0; i < 40; ++i) {
    ASSERT_TRUE(smoothed[i].pose) << i;
    EXPECT_NEAR(smoothed[i].scale.scale, 1.65, 0.02) << i;
    EXPECT_EQ(smoothed[i].scale.status, i < 20 ? ScaleStatus::kHeld : ScaleStatus::kOk) << i;
  }
  EXPECT_NEAR(smoothed[39].pose->distance - smoothed[0].pose->distance, 1.65 * 39, 0.6);
  for (std::size_t i = 40; i < 60; ++i) {
    EXPECT_FALSE(smoothed[i].pose) << i;
    EXPECT_EQ(smoothed[i].scale.status, ScaleStatus::kUnknown) << i;
  }
}

// Where the filter restarts, its measurements had contradicted it before.
TEST(DriveSmoother, AContradictedHeightIsNotUsedFromTheFirstContradictionOn) {
  Filtered drive;
  for (int i = 0; i < 30; ++i) drive.add(1, 1);
  int restart = 30;
  while (drive.scales.back() < 1.8) {
    drive.add(1, 0.8);
    ++restart;
  }
  ASSERT_GT(restart, 34);
  for (int i = 0; i < 30; ++i) drive.add(1, 0.8);
  const auto smoothed = drive.smoothed();
  EXPECT_NEAR(smoothed[29].scale.scale, 1.65, 0.03);
  for (int i = 30; i < restart + 30; ++i) {
    EXPECT_NEAR(smoothed[static_cast<std::size_t>(i)].scale.scale, 1.65 / 0.8, 0.04) << i;
  }
}

/// The state of a smoother against the least squares solution over all states at once.
TEST(DriveSmoother, StatesAreTheLeastSquaresSolution) {
  constexpr int kSteps = 6;
  ScaleFilterOptions options;
  HeightState state(options, {1.65, 0.05, 0.01});
  const auto H = HeightState::Vector::Unit(HeightState::kHeight);
  const HeightState::Vector speed = HeightState::speedJacobian();
  state.start(0, 0.02 * 0.02, H);
  std::vector<HeightState> predicted{state}, filtered{state};
  // The same as normal equations over (ln h, ln h*, ln of the factor) of each step, without the
  // drift of ln h*, which is negligible.
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(kSteps + 2, kSteps + 2);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(kSteps + 2);
  const auto add = [&](const Eigen::VectorXd& row, double value, double variance) {
    A += row * row.transpose() / variance;
    b += row * value / variance;
  };
  const auto unit = [](int i) { return Eigen::VectorXd::Unit(kSteps + 2, i); };
  add(unit(kSteps), 0, std::pow(0.05 / 1.65, 2));
  add(unit(kSteps + 1), 0, 0.01 * 0.01);
  add(unit(0), 0, 0.02 * 0.02 + 1e-9);
  for (int i = 1; i < kSteps; ++i) {
    const double before = state.variance(H);
    state.predict(0.5, 1e-9, 0.3, 0.02);
    add(unit(i) - unit(i - 1), 0, state.variance(H) - before);
    predicted.push_back(state);
    if (i % 2 == 0) {
      const double value = 0.01 * i;
      state.correct(H, value - state.predicted(H), 0.03 * 0.03);
      add(unit(i), value, 0.03 * 0.03);
    } else {
      const double value = std::log(1.65) + 0.02 * i;
      state.correct(speed, state.speedInnovation(value), 0.01 * 0.01);
      add(unit(kSteps) + unit(kSteps + 1) - unit(i), value - std::log(1.65), 0.01 * 0.01);
    }
    filtered.push_back(state);
  }
  const Eigen::MatrixXd covariance = A.inverse();
  const Eigen::VectorXd expected = covariance * b;
  HeightState next = filtered.back();
  for (int i = kSteps - 1; i >= 0; --i) {
    const auto k = static_cast<std::size_t>(i);
    if (i + 1 < kSteps) next = filtered[k].smoothed(predicted[k + 1], next);
    EXPECT_NEAR(next[HeightState::kHeight], expected[i], 1e-4) << i;
    EXPECT_NEAR(next[HeightState::kCameraHeight], expected[kSteps], 1e-4) << i;
    EXPECT_NEAR(std::sqrt(next.variance(H)), std::sqrt(covariance(i, i)), 1e-4) << i;
  }
}

// Speeds in the second map alone teach the camera height, with which the first one gets its scale.
TEST(DriveSmoother, ALearnedCameraHeightHoldsForEarlierMaps) {
  ScaleFilter filter({}, {0, 0, 0});
  DriveSmoother smoother;
  VoFrame frame;
  frame.status = VoStatus::kTracking;
  const auto add = [&](bool has_speed) {
    frame.stamp_ns += 100'000'000;
    frame.T_w_c.translation().z() += 1;
    filter.predict(1, 0, 0.003);
    filter.update(1, 0.02, 3);
    if (has_speed) filter.updateSpeed(1.4, 0.02);
    smoother.addStep(filter);
    smoother.addFrame(frame, frame.continuity, {}, SpeedTrack(0));
    frame.continuity = Continuity::kSameMap;
  };
  for (int i = 0; i < 30; ++i) add(false);
  EXPECT_FALSE(filter.known());
  filter.startMap();
  smoother.startMap();
  frame.continuity = Continuity::kNewMap;
  frame.T_w_c.translation().z() = 0;
  for (int i = 0; i < 60; ++i) add(true);
  const auto smoothed = smoother.smoothed(recoveryOptions());
  EXPECT_NEAR(smoothed[5].scale.camera_height, 1.4, 0.02);
  EXPECT_NEAR(smoothed[5].scale.scale, 1.4, 0.03);
  EXPECT_TRUE(smoothed[5].pose);
}

// 3 s without images, in which the odometry's speed before would be 14 m/s.
TEST(DriveSmoother, SpeedsThatAgreeBridgeAGapBetweenMaps) {
  ScaleFilter filter({}, {1.4, 0, 0});
  DriveSmoother smoother;
  SpeedTrack speeds(0.05);
  speeds.setAgrees(true);
  VoFrame frame;
  frame.status = VoStatus::kTracking;
  const auto add = [&](double seconds) {
    for (int i = 0; i < 10 * seconds; ++i) {
      frame.stamp_ns += 100'000'000;
      smoother.addSpeed({frame.stamp_ns, 10, 0.05});
      speeds.add({frame.stamp_ns, 10, 0.05});
    }
    frame.T_w_c.translation().z() += 1;
    frame.map_start.stamp_ns =
        frame.map_start.stamp_ns == 0 ? frame.stamp_ns : frame.map_start.stamp_ns;
    filter.predict(1, 0, 0.003);
    filter.update(1, 0.02, 3);
    smoother.addStep(filter);
    smoother.addFrame(frame, frame.continuity, {}, speeds);
    frame.continuity = Continuity::kSameMap;
  };
  for (int i = 0; i < 30; ++i) add(0.1);
  filter.startMap();
  smoother.startMap();
  frame.continuity = Continuity::kNewMap;
  frame.T_w_c.translation().z() = -1;
  frame.map_start.stamp_ns = 0;
  add(3);
  for (int i = 0; i < 30; ++i) add(0.1);
  const auto smoothed = smoother.smoothed(recoveryOptions());
  ASSERT_TRUE(smoothed[29].pose && smoothed[30].pose);
  EXPECT_NEAR(
      (smoothed[30].pose->T_o_c.translation() - smoothed[29].pose->T_o_c.translation()).norm(), 30,
      0.5);
}

}  // namespace
}  // namespace gsv
