#include "ground_scale_vo/evaluation/run_record.hpp"

#include <gtest/gtest.h>

#include <stdexcept>

#include "scripted_run.hpp"

namespace ground_scale_vo {
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

TEST(RunRecord, FirstScaleMayBelongToALaterMap) {
  ScriptedRun run;
  run.withoutPose(kInitialising)
      .tracked(1, 0, {{0, 0}, {1, 1}})
      .withoutPose(kLost);  // frames 0, 1, 2
  run.withoutPose(kInitialising, 1).tracked(2, 1, {{3, 0}, {4, 2}}).metric(3, 4, 12, 1);
  EXPECT_EQ(zOf(run.record().metricPoses()), (std::vector<double>{0, 0, 0, 0, 8, 12}));
  EXPECT_EQ(backfilled(run.record()), (std::vector<int>{1, 1, 1, 1, 1, 0}));
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

TEST(RunRecord, RejectsFramesThatAreNotInOrder) {
  RunRecord record;
  VisualOdometry::Output vo;
  vo.frame.sequence = 1;
  EXPECT_THROW(record.append(vo, {}), std::logic_error);
}

}  // namespace
}  // namespace ground_scale_vo
