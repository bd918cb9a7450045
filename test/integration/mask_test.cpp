// The pipeline with a mask of image regions that never show the scene.

#include <gtest/gtest.h>

#include <vector>

#include "simulation/scenario_evaluation.hpp"
#include "support/drive_run.hpp"
#include "support/textured_hood.hpp"

namespace ground_scale_vo {
namespace {

struct HoodDrive {
  double share;  ///< of the image height that the hood covers
  std::uint64_t seed;
};

class Mask : public testing::TestWithParam<HoodDrive> {};

TEST_P(Mask, MakesATexturedHoodHarmless) {
  Scenario scenario;
  scenario.options.frames = 90;
  scenario.options.random_seed = GetParam().seed;
  const SyntheticDrive drive(scenario.options);
  const TexturedHood hood({drive.camera().width, drive.camera().height}, GetParam().share);
  std::vector<cv::Mat> images;
  for (const cv::Mat& image : renderDrive(drive)) images.push_back(hood.cover(image));

  const auto violated = [&](const cv::Mat& mask) {
    return violatedThreshold(
        evaluateScenario(scenario, drive, runDrive(drive, images, {}, {}, mask)),
        scenario.thresholds);
  };
  EXPECT_EQ(violated(hood.mask()), "");
  EXPECT_NE(violated({}), "") << "the hood does not disturb";
}

INSTANTIATE_TEST_SUITE_P(Hoods, Mask, testing::Values(HoodDrive{0.2, 3}, HoodDrive{0.28, 2}));

}  // namespace
}  // namespace ground_scale_vo
