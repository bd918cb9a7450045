#include "ground_scale_vo/scale/paper_preset.hpp"

#include <gtest/gtest.h>

#include "support/road_scene.hpp"

namespace ground_scale_vo {
namespace {

TEST(PaperPreset, UsesThePapersMethodAndNumbersWithPaperLiteral) {
  ScaleRecovery::Options options = recoveryOptions();
  options.random_seed = 7;
  EXPECT_TRUE(options.resolved().refine);
  options.paper_literal = true;
  const ScaleRecovery::Options paper = options.resolved();
  EXPECT_NO_THROW(paper.validate());
  EXPECT_FALSE(paper.refine);
  EXPECT_TRUE(paper.gpe.frame_pitch_test);
  EXPECT_FALSE(paper.gpa.unique_features);
  EXPECT_EQ(paper.gpa.fit.method, PlaneFit::Method::kHomogeneous);
  EXPECT_NEAR(paper.gpe.plane_threshold_heights * paper.camera_height, 0.01, 1e-12);
  EXPECT_NEAR(paper.gpa.fit.reject_distance_heights * paper.camera_height, 0.01, 1e-12);
  EXPECT_NEAR(paper.gpe.pitch_tolerance_rad * 180 / M_PI, 5, 0.01);
  EXPECT_EQ(paper.gpa.max_frames, 4);
  EXPECT_EQ(paper.gpe.random_seed, 7u);
}

}  // namespace
}  // namespace ground_scale_vo
