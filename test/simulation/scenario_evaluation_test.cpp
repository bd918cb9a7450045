#include "simulation/scenario_evaluation.hpp"

#include "support/test.hpp"

namespace gsv {
namespace {

using Metrics = ScenarioMetrics;

TEST(ScenarioEvaluation, LateScaleAndUnknownErrorViolateAThreshold) {
  Metrics metrics;
  metrics.frames = metrics.tracked_frames = 100;
  metrics.metric_frames = 90;
  metrics.rle_percent = 0.5;
  metrics.displacement_sigmas = 1;
  metrics.rotation_error_deg = 0.3;
  metrics.within_2_sigma = 0.9;
  const std::pair<std::function<void(Metrics*)>, const char*> kChanges[] = {
      {[](Metrics*) {}, ""},
      {[](Metrics* m) { m->lost_events = 1; }, "lost"},
      {[](Metrics* m) { m->metric_frames = 50; }, "late scale"},
      {[](Metrics* m) { m->rle_percent = NAN; }, "RLE"},
      {[](Metrics* m) { m->recovery_frames = -1; }, "no recovery"},
      {[](Metrics* m) { m->error_after_fault_percent = 5.1; }, "error after the fault"}};
  for (const auto& [change, violated] : kChanges) {
    Metrics changed = metrics;
    change(&changed);
    EXPECT_EQ(violatedThreshold(changed, ScenarioThresholds()), violated);
  }
}

/// Of a drive of 20 frames with a scale that is 3 % too large: a metric pose from frame 4 on, whose
/// variance grows, a wrong heading in the last frame, and five unobservable frames, two of them
/// reported as measured.
TEST(ScenarioEvaluation, ComparesARunWithTheDrive) {
  Scenario scenario;
  scenario.unobservable = {10, 14};
  SyntheticDrive::Options options;
  options.frames = 20;
  const SyntheticDrive drive(options);
  RunRecord record;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(i);
    vo.frame.status = i == 8 ? VoStatus::kLost : VoStatus::kTracking;
    vo.frame.T_w_c = drive.frame(i).T_c0_c;
    ScaleRecovery::Output scale;
    scale.scale.status = i >= 10 && i <= 12 ? ScaleStatus::kHeld : ScaleStatus::kOk;
    scale.scale.scale = 1.03;
    scale.scale.sigma = i < 13 ? 0.01 : 0.02;
    if (i >= 4) {
      scale.pose.emplace();
      scale.pose->T_o_c = vo.frame.T_w_c;
      scale.pose->T_o_c.translation() *= 1.03;
      scale.pose->covariance.setIdentity();
      scale.pose->covariance *= static_cast<double>(i);
      scale.pose->covariance.topLeftCorner<3, 3>() *= 0.01;
      scale.pose->covariance.bottomRightCorner<3, 3>() *= 1e-9;
    }
    if (i + 1 == drive.size()) {
      scale.pose->T_o_c.rotate(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY()));
    }
    record.append(vo, scale);
  }
  const Metrics metrics = evaluateScenario(scenario, drive, record);
  EXPECT_EQ(metrics.frames, 20u);
  EXPECT_EQ(metrics.tracked_frames, 19u);
  EXPECT_EQ(metrics.lost_events, 1u);
  EXPECT_EQ(metrics.metric_frames, 16u);
  EXPECT_NEAR(metrics.rle_percent, 3, 1e-6);
  EXPECT_NEAR(metrics.rotation_error_deg, 0.02 * 180 / M_PI, 1e-6);
  const double length =
      (drive.frame(19).T_c0_c.translation() - drive.frame(4).T_c0_c.translation()).norm();
  EXPECT_NEAR(metrics.displacement_sigmas, 0.03 * length / std::sqrt(0.01 * 15), 1e-3);
  EXPECT_NEAR(metrics.scale_error_percent, 3, 1e-6);
  EXPECT_NEAR(metrics.within_2_sigma, 7. / 19, 1e-9);  // frame 8 has no true scale
  EXPECT_NEAR(metrics.held_share, 3. / 16, 1e-9);
  EXPECT_NEAR(metrics.ok_while_unobservable, 2. / 5, 1e-9);
}

/// A fault in frames 10 to 19, in which the position jumps by 3 m. The scale is held until frame 24
/// and 2 % too large afterwards.
TEST(ScenarioEvaluation, DescribesTheReactionToAFault) {
  Scenario scenario;
  scenario.options.frames = 80;
  scenario.options.stop_s = 0;
  scenario.fault = {10, 19};
  const SyntheticDrive drive(scenario.options);
  RunRecord record;
  double z = 0;  // along the path
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const double step = 0.9;
    z += i == 0 ? 0 : step * (i > 24 ? 1.02 : 1) + (i == 15 ? 3 : 0);
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(i);
    vo.frame.status = VoStatus::kTracking;
    ScaleRecovery::Output scale;
    scale.scale.status = i >= 10 && i < 25 ? ScaleStatus::kHeld : ScaleStatus::kOk;
    scale.scale.scale = scale.scale.sigma = 1;
    scale.pose.emplace();
    scale.pose->T_o_c = drive.frame(i).T_c0_c;
    scale.pose->T_o_c.translation() *=
        z / (step * static_cast<double>(std::max<std::size_t>(i, 1)));
    scale.pose->covariance.setIdentity();
    record.append(vo, scale);
  }
  const Metrics metrics = evaluateScenario(scenario, drive, record);
  EXPECT_EQ(metrics.recovery_frames, 5);
  EXPECT_NEAR(metrics.error_after_fault_percent, 2, 1.5);
}

}  // namespace
}  // namespace gsv
