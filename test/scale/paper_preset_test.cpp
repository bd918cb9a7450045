#include "ground_scale_vo/scale/paper_preset.hpp"

#include <gtest/gtest.h>

#include "support/recovery_options.hpp"

namespace ground_scale_vo {
namespace {

TEST(PaperPreset, UsesThePapersNumbersForTheCameraHeight) {
  const ScaleRecovery::Options paper = paperPreset(recoveryOptions());
  EXPECT_NEAR(paper.gpe.plane_threshold_heights * paper.camera_height, 0.01, 1e-12);
  EXPECT_EQ(paper.gpe.plane_threshold_sigma, 0);
  EXPECT_NEAR(paper.gpa.fit.reject_distance_heights * paper.camera_height, 0.01, 1e-12);
  EXPECT_NEAR(paper.gpe.motion_tolerance_rad * 180 / M_PI, 5, 0.01);
  EXPECT_NEAR(paper.gpe.pitch_tolerance_rad * 180 / M_PI, 5, 0.01);
  EXPECT_EQ(paper.gpa.min_frames, 4);
  EXPECT_EQ(paper.gpa.max_frames, 4);
  EXPECT_EQ(paper.filter.moving_average_frames, 20);
  EXPECT_NO_THROW(paper.validate());
}

TEST(PaperPreset, UsesThePapersMethod) {
  const ScaleRecovery::Options paper = paperPreset(recoveryOptions());
  EXPECT_FALSE(paper.refine);
  EXPECT_EQ(paper.standstill_distance_heights, 0);
  // The direction of motion is that between two frames: any step is longer than this chord.
  EXPECT_LE(paper.mounting.chord_length_heights, 0.01);
  EXPECT_TRUE(paper.gpe.frame_pitch_test);
  EXPECT_TRUE(paper.gpe.most_inliers);
  EXPECT_FALSE(paper.gpa.unique_features);
  EXPECT_EQ(paper.gpa.fit.method, PlaneFit::Method::kHomogeneous);
  // The whole image, and a window that only the number of frames limits.
  EXPECT_EQ(paper.gpe.min_lane_features, 0);
  for (const double length : {paper.gpe.lane_half_width_heights, paper.gpe.max_half_width_heights,
                              paper.gpe.max_ahead_heights, paper.gpa.window_heights}) {
    EXPECT_GE(length, 1000);
  }
}

TEST(PaperPreset, IsAppliedOnlyWithPaperLiteral) {
  ScaleRecovery::Options o = recoveryOptions();
  o.random_seed = 7;
  EXPECT_TRUE(o.resolved().refine);
  EXPECT_EQ(o.resolved().gpe.random_seed, 7u);
  o.paper_literal = true;
  EXPECT_FALSE(o.resolved().refine);
  EXPECT_EQ(o.resolved().gpe.random_seed, 7u);
}

}  // namespace
}  // namespace ground_scale_vo
