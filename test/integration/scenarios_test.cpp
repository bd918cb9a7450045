// The pipeline on the rendered drives of the scenario catalogue, against exact ground truth.

#include "ground_scale_vo/simulation/scenarios.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <ostream>
#include <string>
#include <vector>

#include "ground_scale_vo/simulation/scenario_evaluation.hpp"
#include "support/sanitizer.hpp"

namespace ground_scale_vo {

void PrintTo(const Scenario& scenario, std::ostream* stream) { *stream << scenario.name; }

namespace {

class ScenarioDrive : public testing::TestWithParam<Scenario> {};

/// Checks that the ground truth is consistent: the translation along the normal is the change of
/// height.
void expectConsistentGroundTruth(const Scenario& scenario, const SyntheticDrive& drive) {
  // On ramps and bumps the axles climb one after the other, so the car leaves its own plane.
  const bool has_edges = scenario.options.ramp_slope != 0 || scenario.options.bump_height != 0;
  const double edge_tolerance = std::max(0.025, 0.31 * scenario.options.bump_height);  // [m]
  for (std::size_t i = 0; i + 1 < drive.size(); ++i) {
    const SyntheticDrive::Frame &a = drive.frame(i), &b = drive.frame(i + 1);
    const Eigen::Isometry3d T_a_b = a.T_c0_c.inverse() * b.T_c0_c;
    const double change_of_normal = (T_a_b.linear() * b.n_c - a.n_c).norm();
    // For a constant vertical curvature the factor of the second term would be 0.5.
    const double tolerance =
        has_edges ? edge_tolerance : 1e-3 + 0.6 * change_of_normal * T_a_b.translation().norm();
    EXPECT_NEAR(a.n_c.norm(), 1, 1e-12);
    EXPECT_NEAR(a.height + a.n_c.dot(T_a_b.translation()), b.height, tolerance) << i;
  }
}

/// Checks that the scenario depends on its component: no threshold is violated with the `base`
/// settings, and one is with the `disable` settings added.
void expectDependence(const Scenario& scenario, const SyntheticDrive& drive,
                      const std::vector<cv::Mat>& images) {
  const ScenarioAblation& ablation = scenario.ablation;
  if (ablation.disable.empty()) return;
  const auto violated = [&](const std::vector<std::string>& settings) {
    return violatedThreshold(evaluateScenario(scenario, drive, runDrive(drive, images, settings)),
                             scenario.thresholds);
  };
  if (!ablation.base.empty()) {
    EXPECT_EQ(violated(ablation.base), "");
  }
  std::vector<std::string> settings = ablation.base;
  settings.insert(settings.end(), ablation.disable.begin(), ablation.disable.end());
  EXPECT_NE(violated(settings), "") << "does not depend on: " << ablation.component;
}

TEST_P(ScenarioDrive, MeetsItsThresholdsAndDependsOnItsComponent) {
  const Scenario& scenario = GetParam();
  const SyntheticDrive drive(scenario.options);
  expectConsistentGroundTruth(scenario, drive);
  const std::vector<cv::Mat> images = renderDrive(drive);
  const ScenarioMetrics metrics = evaluateScenario(scenario, drive, runDrive(drive, images));
  std::printf(
      "%s: RLE %.2f %%, scale %.2f %%, held %.2f, within 2 sigma %.2f, ok while unobservable "
      "%.2f\n",
      scenario.name.c_str(), metrics.rle_percent, metrics.scale_error_percent, metrics.held_share,
      metrics.within_2_sigma, metrics.ok_while_unobservable);
  EXPECT_EQ(violatedThreshold(metrics, scenario.thresholds), "");
  expectDependence(scenario, drive, images);
}

std::vector<Scenario> drivesToRun() {
  const std::vector<Scenario> all = allScenarios();
  std::vector<Scenario> some;
  for (std::size_t i = 0; i < all.size(); i += kDriveStride) some.push_back(all[i]);
  return some;
}

INSTANTIATE_TEST_SUITE_P(Drives, ScenarioDrive, testing::ValuesIn(drivesToRun()),
                         [](const auto& drive) { return drive.param.name; });

}  // namespace
}  // namespace ground_scale_vo
