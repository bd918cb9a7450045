// The pipeline on the rendered drives of the scenario catalogue, against exact ground truth.

#include "simulation/scenarios.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_report.hpp"
#include "simulation/scenario_evaluation.hpp"
#include "support/drive_run.hpp"
#include "support/long_tests.hpp"

namespace gsv {

void PrintTo(const Scenario& scenario, std::ostream* stream) { *stream << scenario.name; }

namespace {

class ScenarioDrive : public testing::TestWithParam<Scenario> {};

/// Checks that the scenario depends on its component: no threshold is violated with the `base`
/// settings, and one is with the `disable` settings added. A reduced drive only runs.
void expectDependence(const Scenario& scenario, const SyntheticDrive& drive,
                      const std::vector<cv::Mat>& images) {
  const ScenarioAblation& ablation = scenario.ablation;
  if (ablation.disable.empty()) return;
  const auto violated = [&](const std::vector<std::string>& settings) {
    return violatedThreshold(evaluateScenario(scenario, drive, runDrive(drive, images, settings)),
                             scenario.thresholds);
  };
  const std::string with_base = ablation.base.empty() ? "" : violated(ablation.base);
  std::vector<std::string> settings = ablation.base;
  settings.insert(settings.end(), ablation.disable.begin(), ablation.disable.end());
  const std::string without_component = violated(settings);
  if (isReduced(scenario.options)) return;
  EXPECT_EQ(with_base, "");
  EXPECT_NE(without_component, "") << "does not depend on: " << ablation.component;
}

TEST_P(ScenarioDrive, MeetsItsThresholdsAndDependsOnItsComponent) {
  const Scenario& scenario = GetParam();
  const SyntheticDrive drive(reducedDrive(scenario.options));
  const std::vector<cv::Mat> images = renderDrive(drive);
  const RunRecord record = runDrive(drive, images);
  const ScenarioMetrics metrics = evaluateScenario(scenario, drive, record);
  std::printf(
      "%s: RLE %.2f %%, scale %.2f %%, held %.2f, within 2 sigma %.2f, ok while unobservable "
      "%.2f\n",
      scenario.name.c_str(), metrics.rle_percent, metrics.scale_error_percent, metrics.held_share,
      metrics.within_2_sigma, metrics.ok_while_unobservable);
  const std::string violated = violatedThreshold(metrics, scenario.thresholds);
  if (!isReduced(scenario.options)) {
    EXPECT_EQ(violated, "");
  }
  expectDependence(scenario, drive, images);
}

/// Drives that run with --long only: another drive with the same difficulty always runs.
const std::set<std::string> kLongDrives = {
    "van_close_ahead", "hood",        "jpeg",       "crawl_start", "tree_shadows",   "puddles",
    "cobbles",         "smooth_lane", "hill",       "tight_bends", "speed_bumps",    "stop",
    "night",           "camera_low",  "wide_angle", "camera_high", "large_image",    "motorway",
    "pitched",         "rolled",      "camera_45",  "cars_beside", "stop_after_8_m", "small_steps",
    "black_1s",        "black_2s",    "black_fast"};

/// The long ones, or the others.
std::vector<Scenario> drivesToRun() {
  std::vector<Scenario> some;
  for (const std::string& name : kLongDrives) {
    if (runsLongTests()) some.push_back(findScenario(name));
  }
  for (const Scenario& scenario : allScenarios()) {
    if (!runsLongTests() && kLongDrives.count(scenario.name) == 0) some.push_back(scenario);
  }
  return some;
}

INSTANTIATE_TEST_SUITE_P(Drives, ScenarioDrive, testing::ValuesIn(drivesToRun()),
                         [](const auto& drive) { return drive.param.name; });

}  // namespace
}  // namespace gsv
