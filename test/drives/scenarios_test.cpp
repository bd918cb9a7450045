// The pipeline on the rendered drives of the scenario catalogue, against exact ground truth.

#include "ground_scale_vo/simulation/scenarios.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/simulation/scenario_evaluation.hpp"
#include "support/drive_run.hpp"
#include "support/long_tests.hpp"
#include "support/reduced_drive.hpp"

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
/// settings, and one is with the `disable` settings added. A reduced drive only runs.
void expectDependence(const Scenario& scenario, const SyntheticDrive& drive,
                      const std::vector<cv::Mat>& images) {
  const ScenarioAblation& ablation = scenario.ablation;
  if (ablation.disable.empty()) return;
  const auto violated = [&](const std::vector<std::string>& settings) {
    return violatedThreshold(evaluateScenario(scenario, drive, runDrive(drive, images, settings)),
                             scenario.thresholds);
  };
  const bool is_reduced = isReduced(scenario.options);
  if (!ablation.base.empty()) {
    const std::string with_base = violated(ablation.base);
    if (!is_reduced) {
      EXPECT_EQ(with_base, "");
    }
  }
  std::vector<std::string> settings = ablation.base;
  settings.insert(settings.end(), ablation.disable.begin(), ablation.disable.end());
  const std::string without_component = violated(settings);
  if (!is_reduced) {
    EXPECT_NE(without_component, "") << "does not depend on: " << ablation.component;
  }
}

TEST_P(ScenarioDrive, MeetsItsThresholdsAndDependsOnItsComponent) {
  const Scenario& scenario = GetParam();
  const SyntheticDrive drive(reducedDrive(scenario.options));
  expectConsistentGroundTruth(scenario, drive);
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

/// A drive that is a long test, and one that runs by default and checks the same behaviour.
struct LongDrive {
  const char *name, *instead;
};
constexpr LongDrive kLongDrives[] = {
    {"van_close_ahead", "car_close_ahead"},
    {"hood", "car_close_ahead"},  // hardly any road for the direct measurement
    {"jpeg", "car_close_ahead"},  // no texture for the direct measurement
    {"crawl_start", "turn_start"},
    {"tree_shadows", "own_shadow"},
    {"puddles", "arrows_and_lines"},  // points that are not on the road
    {"cobbles", "off_road"},          // strong vibrations
    {"smooth_lane", "weak_texture"},
    {"speed_bumps", "slope_edges"},
    {"hill", "slope_edges"},
    {"tight_bends", "crawl_bends"},
    {"stop", "reversing"},
    {"night", "night_noisy"},
    {"camera_low", "camera_side"},  // another height and focal length; heights: covariance_test
    {"camera_high", "pitched_20"},  // likewise
    {"wide_angle", "rolled_15"},    // a wide field of view
    {"large_image", "tele"},        // another resolution
    {"motorway", "large_steps"},
    {"pitched", "pitched_20"},
    {"rolled", "rolled_15"},
    {"camera_45", "camera_side"},
    {"black_1s", "black_turn"},
    {"black_fast", "black_turn"},
    {"cars_beside", "kerb_side"},  // what is beside the lane is outside of its region
    {"stop_after_8_m", "turn_start"},
    {"small_steps", "crawl_bends"},  // baseline of the direct measurement: image_buffer_test
    {"black_2s", "black_5s"},
};

/// The long ones, or the others.
std::vector<Scenario> drivesToRun() {
  std::vector<Scenario> some;
  for (const Scenario& scenario : allScenarios()) {
    const bool is_long =
        std::any_of(std::begin(kLongDrives), std::end(kLongDrives),
                    [&](const LongDrive& drive) { return scenario.name == drive.name; });
    if (is_long == runsLongTests()) some.push_back(scenario);
  }
  return some;
}

TEST(LongDrives, HaveADriveThatAlwaysRuns) {
  std::set<std::string> long_drives;
  for (const LongDrive& drive : kLongDrives) {
    EXPECT_EQ(findScenario(drive.name).name, drive.name);
    long_drives.insert(drive.name);
  }
  for (const LongDrive& drive : kLongDrives) {
    EXPECT_EQ(findScenario(drive.instead).name, drive.instead);
    EXPECT_EQ(long_drives.count(drive.instead), 0u) << drive.instead;
  }
}

INSTANTIATE_TEST_SUITE_P(Drives, ScenarioDrive, testing::ValuesIn(drivesToRun()),
                         [](const auto& drive) { return drive.param.name; });

}  // namespace
}  // namespace ground_scale_vo
