#include "ground_scale_vo/evaluation/run_failure.hpp"

#include <gtest/gtest.h>

#include "scripted_run.hpp"

namespace gsv {
namespace {

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
