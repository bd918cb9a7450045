#include "scale/drive_smoother.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "support/road_scene.hpp"

namespace gsv {
namespace {

TEST(DriveSmoother, IsEmptyUnlessTheDriveIsRecordedAndRefusesAMovingAverage) {
  ScaleRecovery::Options options = recoveryOptions();
  ScaleRecovery recovery(options);
  recovery.process(RoadScene().frame(0));
  EXPECT_TRUE(recovery.smoothed().empty());
  options.record = true;
  options.filter.moving_average_frames = 10;
  EXPECT_THROW(ScaleRecovery(options).smoothed(), OptionError);
}

/// A drive as the scale filter sees it: heights with a given error.
struct Filtered {
  ScaleFilter filter;
  DriveSmoother smoother;
  SpeedTrack speeds{0.05};
  VoFrame frame;
  double sensor_speed = 0;    ///< [m/s] 0: no sensor
  double filtered_speed = 0;  ///< that the filter uses [m per 0.1 s]; 0: none
  std::vector<double> scales, sigmas;

  explicit Filtered(double camera_height = 1.65) : filter({}, {camera_height, 0, 0}) {
    frame.status = VoStatus::kTracking;
    startMap();
  }
  void startMap() {
    filter.startMap();
    smoother.startMap();
    frame.continuity = frame.stamp_ns > 0 ? Continuity::kNewMap : Continuity::kSameMap;
    frame.map_start.stamp_ns = 0;
    frame.T_w_c.translation().z() = -1;  // the first frame is at the origin
  }
  /// A frame after a step of 1 VO unit and some tenths of a second; height: measured, 0: none.
  void add(double height, double sigma = 0.02, int tenths = 1) {
    for (int i = 0; i < tenths; ++i) {
      frame.stamp_ns += 100'000'000;
      if (sensor_speed == 0) continue;
      smoother.addSpeed({frame.stamp_ns, sensor_speed, 0.05});
      speeds.add({frame.stamp_ns, sensor_speed, 0.05});
    }
    if (frame.map_start.stamp_ns == 0) frame.map_start.stamp_ns = frame.stamp_ns;
    frame.T_w_c.translation().z() += 1;
    filter.predict(1, 0, 0.003);
    if (height > 0) filter.update(height, sigma * height, 3 * height);
    if (filtered_speed > 0) filter.updateSpeed(filtered_speed, 0.02);
    smoother.addStep(filter);
    ScaleEstimate scale;
    scale.status = filter.known() ? ScaleStatus::kOk : ScaleStatus::kUnknown;
    scale.scale = filter.scale();
    scale.sigma = filter.scaleSigma();
    smoother.addFrame(frame, frame.continuity, scale, speeds);
    frame.continuity = Continuity::kSameMap;
    scales.push_back(filter.scale());
    sigmas.push_back(filter.scaleSigma());
  }
  std::vector<ScaleRecovery::Smoothed> smoothed() const {
    return smoother.smoothed(recoveryOptions());
  }
};

TEST(DriveSmoother, ALaterMeasurementCorrectsEarlierFramesAndTheLastOneIsTheFilters) {
  Filtered drive;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.03);
  for (int i = 0; i < 200; ++i) drive.add(std::exp(noise(random)), 0.03);
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
  for (int i = 0; i < 40; ++i) drive.add(i < 20 ? 0 : 1);
  ASSERT_EQ(drive.scales[19], 0);
  drive.startMap();
  for (int i = 0; i < 20; ++i) drive.add(0);
  const auto smoothed = drive.smoothed();
  for (std::size_t i = 0; i < 60; ++i) {
    ASSERT_EQ(smoothed[i].pose.has_value(), i < 40) << i;
    EXPECT_EQ(smoothed[i].scale.status, i < 20   ? ScaleStatus::kHeld
                                        : i < 40 ? ScaleStatus::kOk
                                                 : ScaleStatus::kUnknown)
        << i;
    EXPECT_NEAR(smoothed[i].scale.scale, i < 40 ? 1.65 : 0, 0.02) << i;
  }
  EXPECT_NEAR(smoothed[39].pose->distance - smoothed[0].pose->distance, 1.65 * 39, 0.6);
}

// Where the filter restarts, its measurements had contradicted it before.
TEST(DriveSmoother, AContradictedHeightIsNotUsedFromTheFirstContradictionOn) {
  Filtered drive;
  for (int i = 0; i < 30; ++i) drive.add(1);
  while (drive.scales.back() < 1.8) drive.add(0.8);
  ASSERT_GT(drive.scales.size(), 34u);
  for (int i = 0; i < 30; ++i) drive.add(0.8);
  const auto smoothed = drive.smoothed();
  EXPECT_NEAR(smoothed[29].scale.scale, 1.65, 0.03);
  for (std::size_t i = 30; i < smoothed.size(); ++i) {
    EXPECT_NEAR(smoothed[i].scale.scale, 1.65 / 0.8, 0.04) << i;
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
  Filtered drive(0);
  for (int i = 0; i < 30; ++i) drive.add(1);
  EXPECT_FALSE(drive.filter.known());
  drive.startMap();
  drive.filtered_speed = 1.4;
  for (int i = 0; i < 60; ++i) drive.add(1);
  const auto smoothed = drive.smoothed();
  EXPECT_NEAR(smoothed[5].scale.camera_height, 1.4, 0.02);
  EXPECT_NEAR(smoothed[5].scale.scale, 1.4, 0.03);
  EXPECT_TRUE(smoothed[5].pose);
}

// 3 s without images, in which the odometry's speed before would be 14 m/s.
TEST(DriveSmoother, SpeedsThatAgreeBridgeAGapBetweenMaps) {
  Filtered drive(1.4);
  drive.speeds.setAgrees(true);
  drive.sensor_speed = 10;
  for (int i = 0; i < 30; ++i) drive.add(1);
  drive.startMap();
  drive.add(1, 0.02, 30);
  for (int i = 0; i < 30; ++i) drive.add(1);
  const auto smoothed = drive.smoothed();
  ASSERT_TRUE(smoothed[29].pose && smoothed[30].pose);
  EXPECT_NEAR(
      (smoothed[30].pose->T_o_c.translation() - smoothed[29].pose->T_o_c.translation()).norm(), 30,
      0.5);
}

}  // namespace
}  // namespace gsv
