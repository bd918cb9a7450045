#include "ground_scale_vo/evaluation/run_record.hpp"

#include <gtest/gtest.h>

#include <stdexcept>

#include "run_script.hpp"

namespace ground_scale_vo {
namespace {

std::vector<double> forward(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<double> z;
  for (const auto& pose : poses) z.push_back(pose.translation().z());
  return z;
}

std::vector<int> backfilled(const RunRecord& record) {
  std::vector<int> flags;
  for (const RunFrame& frame : record.frames()) flags.push_back(frame.backfilled);
  return flags;
}

TEST(RunRecord, FillsTheStartBackwardsWithoutAStep) {
  const Script script = started();
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 0, 3, 6, 8, 10, 12}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{1, 1, 1, 1, 1, 0, 0}));
  EXPECT_EQ(forward(script.record().unscaledPoses()), (std::vector<double>{0, 0, 1.5, 3, 4, 5, 6}));
  EXPECT_EQ(script.record().trackedFrames(), 6u);
  EXPECT_EQ(script.record().lostEvents(), 0u);
}

TEST(RunRecord, HoldsTheLastPoseWhileLostAndUntilALaterMapHasItsScale) {
  Script script = started();
  script.no(kLost).no(kInitialising, 1);                      // frames 7, 8
  script.tracks(7, 1, {{8, 0}, {9, 7}}).metric(9, 3, 12, 1);  // frames 9, 10
  script.metric(11, 3, 18, 1);
  EXPECT_EQ(forward(script.record().metricPoses()),
            (std::vector<double>{0, 0, 3, 6, 8, 10, 12, 12, 12, 12, 12, 18}));
  // Up to scale, the later map continues from the last pose of the first one.
  EXPECT_EQ(forward(script.record().unscaledPoses()),
            (std::vector<double>{0, 0, 1.5, 3, 4, 5, 6, 6, 6, 13, 15, 17}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(script.record().trackedFrames(), 10u);
  EXPECT_EQ(script.record().lostEvents(), 1u);
}

TEST(RunRecord, FirstScaleMayBelongToALaterMap) {
  Script script;
  script.no(kInitialising).tracks(1, 0, {{0, 0}, {1, 1}}).no(kLost);  // frames 0, 1, 2
  script.no(kInitialising, 1).tracks(2, 1, {{3, 0}, {4, 2}}).metric(3, 4, 12, 1);
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 0, 0, 0, 8, 12}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{1, 1, 1, 1, 1, 0}));
}

TEST(RunRecord, AFrameWithoutAPoseInTheFilledStartHoldsTheOneBefore) {
  Script script;
  script.tracks(0).tracks(1).no(kLost).tracks(3).metric(4, 2, 8);
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 2, 2, 6, 8}));
  EXPECT_EQ(script.record().lostEvents(), 1u);
  EXPECT_EQ(script.record().trackedFrames(), 4u);
}

TEST(RunRecord, StaysAtTheOriginWithoutAScale) {
  Script script;
  script.no(kInitialising).tracks(1, 0, {{0, 0}, {1, 1}}).tracks(2);
  EXPECT_EQ(forward(script.record().metricPoses()), (std::vector<double>{0, 0, 0}));
  EXPECT_EQ(forward(script.record().unscaledPoses()), (std::vector<double>{0, 1, 2}));
  EXPECT_EQ(backfilled(script.record()), (std::vector<int>{0, 0, 0}));
}

TEST(RunRecord, RejectsFramesThatAreNotInOrder) {
  RunRecord record;
  VisualOdometry::Output vo;
  vo.frame.sequence = 1;
  EXPECT_THROW(record.append(vo, {}), std::logic_error);
}

}  // namespace
}  // namespace ground_scale_vo
