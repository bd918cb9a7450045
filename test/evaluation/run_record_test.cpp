#include "ground_scale_vo/evaluation/run_record.hpp"

#include "ground_scale_vo/evaluation/run_failure.hpp"
#include "scripted_run.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

/// Positions along z.
std::vector<double> zOf(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<double> z;
  for (const auto& pose : poses) z.push_back(pose.translation().z());
  return z;
}

std::vector<int> backfilled(const RunRecord& record) {
  std::vector<int> flags;
  for (const RunFrame& frame : record.frames()) flags.push_back(frame.backfilled);
  return flags;
}

TEST(RunRecord, BackfillsTheStartWithoutAJump) {
  const ScriptedRun run = runWithInitialisation();
  EXPECT_EQ(zOf(run.record().metricPoses()), (std::vector<double>{0, 0, 3, 6, 8, 10, 12}));
  EXPECT_EQ(backfilled(run.record()), (std::vector<int>{1, 1, 1, 1, 1, 0, 0}));
  EXPECT_EQ(zOf(run.record().unscaledPoses()), (std::vector<double>{0, 0, 1.5, 3, 4, 5, 6}));
  EXPECT_EQ(run.record().trackedFrames(), 6u);
  EXPECT_EQ(run.record().lostEvents(), 0u);

  std::vector<ScaleRecovery::Smoothed> smoothed(7);
  for (std::size_t i = 5; i < 7; ++i) {
    smoothed[i].scale.status = ScaleStatus::kOk;
    smoothed[i].scale.scale = 3;
    smoothed[i].pose.emplace();
    smoothed[i].pose->T_o_c = ahead(3.0 * static_cast<double>(i));
  }
  RunRecord record = run.record();
  record.smooth(smoothed);
  EXPECT_EQ(zOf(record.metricPoses()), (std::vector<double>{0, 0, 4.5, 9, 12, 15, 18}));
}

TEST(RunRecord, HoldsTheLastPoseFromALossUntilTheNextMapHasItsScale) {
  ScriptedRun run = runWithInitialisation();
  run.withoutPose(kLost).withoutPose(kInitialising, 1);     // frames 7, 8
  run.tracked(7, 1, {{8, 0}, {9, 7}}).metric(9, 3, 12, 1);  // frames 9, 10
  run.metric(11, 3, 18, 1);
  EXPECT_EQ(zOf(run.record().metricPoses()),
            (std::vector<double>{0, 0, 3, 6, 8, 10, 12, 12, 12, 12, 12, 18}));
  // Up to scale, the later map continues from the last pose of the first one.
  EXPECT_EQ(zOf(run.record().unscaledPoses()),
            (std::vector<double>{0, 0, 1.5, 3, 4, 5, 6, 6, 6, 13, 15, 17}));
  EXPECT_EQ(backfilled(run.record()), (std::vector<int>{1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(run.record().trackedFrames(), 10u);
  EXPECT_EQ(run.record().lostEvents(), 1u);
}

TEST(RunRecord, ABackfilledFrameWithoutAVoPoseRepeatsThePreviousPose) {
  ScriptedRun run;
  run.tracked(0).tracked(1).withoutPose(kLost).tracked(3).metric(4, 2, 8);
  EXPECT_EQ(zOf(run.record().metricPoses()), (std::vector<double>{0, 2, 2, 6, 8}));
  EXPECT_EQ(run.record().lostEvents(), 1u);
  EXPECT_EQ(run.record().trackedFrames(), 4u);
}

TEST(RunRecord, StaysAtTheOriginWithoutAScale) {
  ScriptedRun run;
  run.withoutPose(kInitialising).tracked(1, 0, {{0, 0}, {1, 1}}).tracked(2);
  EXPECT_EQ(zOf(run.record().metricPoses()), (std::vector<double>{0, 0, 0}));
  EXPECT_EQ(zOf(run.record().unscaledPoses()), (std::vector<double>{0, 1, 2}));
  EXPECT_EQ(backfilled(run.record()), (std::vector<int>{0, 0, 0}));
}

/// z forward, turned about the y axis.
Eigen::Isometry3d turned(double angle, double x, double z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << x, 0, z;
  T.rotate(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()));
  return T;
}

TEST(RunRecord, ContinuesInTheAxesOfTheLastPose) {
  RunRecord record;
  const auto append = [&](const Eigen::Isometry3d& T_w_c, std::uint32_t map_id,
                          const std::optional<Eigen::Isometry3d>& T_o_c) {
    ScaleEstimate scale;
    scale.scale = 2;
    appendFrame(&record, T_w_c, T_o_c, Matrix6d::Zero(), scale, map_id);
  };
  const Eigen::Isometry3d first = turned(0.3, 1, 2), second = turned(0.5, 2, 4);
  const Eigen::Isometry3d metric = turned(0.9, 3, 7);
  append(first, 0, {});
  append(second, 0, metric);
  append(turned(-0.4, 1, 1), 1, {});  // another map
  append(turned(-0.4, 1, 1) * turned(0.1, 0, 3), 1, {});
  // The first pose is the metric one minus the motion, which is two metres per unit.
  Eigen::Isometry3d step = first.inverse() * second;
  step.translation() *= 2;
  EXPECT_TRUE(record.metricPoses()[0].isApprox(metric * step.inverse(), 1e-12));
  const auto unscaled = record.unscaledPoses();
  EXPECT_TRUE(unscaled[2].isApprox(second, 1e-12));
  EXPECT_TRUE(unscaled[3].isApprox(second * turned(0.1, 0, 3), 1e-12));
}

/// Ten frames, of which these have another status or reason.
RunRecord runWith(int changed, ScaleStatus status, MeasurementStatus measurement) {
  RunRecord record;
  for (int i = 0; i < 10; ++i) {
    ScaleEstimate scale;
    scale.status = i < changed ? status : ScaleStatus::kOk;
    scale.measurement = i < changed ? measurement : MeasurementStatus::kMeasured;
    appendFrame(&record, ahead(i), ahead(i), Matrix6d::Identity(), scale);
  }
  return record;
}

TEST(RunFailure, AScaleThatIsMostlyHeldIsNoResult) {
  const auto held = [](int frames, MeasurementStatus reason) {
    return failureOf(runWith(frames, ScaleStatus::kHeld, reason));
  };
  EXPECT_EQ(held(5, MeasurementStatus::kNoPlane), "");
  EXPECT_EQ(held(6, MeasurementStatus::kNoPlane).find("the scale is held in 6 of 10 images in mo"),
            0u);
  EXPECT_EQ(held(9, MeasurementStatus::kStandstill), "") << "waiting at a traffic light";
}

TEST(RunFailure, AZoomEndsTheDistances) {
  const RunRecord record = runWith(3, ScaleStatus::kUnknown, MeasurementStatus::kZoomed);
  EXPECT_NE(failureOf(record).find("zoomed while driving: no distance is known for 3 of 10"),
            std::string::npos);
}

TEST(RunFailure, NamesTheMostFrequentReasonWithoutAPose) {
  ScriptedRun run;
  run.tracked(0).withoutPose(VoStatus::kLost).withoutPose(VoStatus::kLost);
  EXPECT_EQ(failureOf(run.record()), "no metric pose: the odometry is lost");
  EXPECT_EQ(failureOf(RunRecord()), "no metric pose: there is no image");
  run.metric(1, 1, 1).withoutPose(VoStatus::kLost);
  EXPECT_EQ(failureOf(run.record()).find("the odometry tracked in only 2 of 5 images: "), 0u);
}

}  // namespace
}  // namespace gsv
