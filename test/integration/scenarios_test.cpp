#include "ground_scale_vo/simulation/scenarios.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "support/sanitizer.hpp"

// Images in, metres out, on drives that are hard for a camera and whose truth is exact.

namespace ground_scale_vo {

void PrintTo(const Scenario& scenario, std::ostream* stream) { *stream << scenario.name; }

namespace {

TEST(Scenarios, AreACatalogue) {
  std::set<std::string> names;
  for (const Scenario& scenario : allScenarios()) {
    EXPECT_TRUE(names.insert(scenario.name).second) << scenario.name;
    EXPECT_NO_THROW(scenario.options.validate()) << scenario.name;
    EXPECT_EQ(findScenario(scenario.name).what, scenario.what);
    if (!scenario.road_hidden) continue;
    EXPECT_LE(scenario.road_hidden->first, scenario.road_hidden->last);
    EXPECT_LT(static_cast<int>(scenario.road_hidden->last), scenario.options.frames);
  }
  try {
    findScenario("fog_of_war");
    FAIL();
  } catch (const OptionError& error) {
    EXPECT_NE(std::string(error.what()).find("puddles"), std::string::npos) << error.what();
  }
}

class ScenarioDrive : public testing::TestWithParam<Scenario> {};

/// The way from one frame to the next along the first one's normal is the change of height.
void expectOneStory(const Scenario& scenario, const SyntheticDrive& drive) {
  // On an edge one axle climbs before the other, so the car does not move along its own plane.
  const bool edges = scenario.options.ramp_slope != 0 || scenario.options.bump_height != 0;
  const double edge = std::max(0.025, 0.31 * scenario.options.bump_height);
  for (std::size_t i = 0; i + 1 < drive.size(); ++i) {
    const SyntheticDrive::Frame &a = drive.frame(i), &b = drive.frame(i + 1);
    const Eigen::Isometry3d T_a_b = a.T_c0_c.inverse() * b.T_c0_c;
    const double turn = (T_a_b.linear() * b.n_c - a.n_c).norm();
    const double allowed = edges ? edge : 1e-3 + 0.6 * turn * T_a_b.translation().norm();
    EXPECT_NEAR(a.n_c.norm(), 1, 1e-12);
    EXPECT_NEAR(a.height + a.n_c.dot(T_a_b.translation()), b.height, allowed) << i;
  }
}

/// The drive needs its remedy: without it a bar breaks that is kept with it.
void expectRemedy(const Scenario& scenario, const SyntheticDrive& drive,
                  const std::vector<cv::Mat>& images) {
  const ScenarioAblation& remedy = scenario.remedy;
  if (remedy.without.empty()) return;
  const auto broken = [&](const std::vector<std::string>& settings) {
    return violatedThreshold(driveFigures(scenario, drive, runDrive(drive, images, settings)),
                             scenario.bars);
  };
  if (!remedy.with.empty()) {
    EXPECT_EQ(broken(remedy.with), "");
  }
  std::vector<std::string> without = remedy.with;
  without.insert(without.end(), remedy.without.begin(), remedy.without.end());
  EXPECT_NE(broken(without), "") << "it does not need: " << remedy.what;
}

TEST_P(ScenarioDrive, IsMeasuredOrHeldAndNeedsItsRemedy) {
  const Scenario& scenario = GetParam();
  const SyntheticDrive drive(scenario.options);
  expectOneStory(scenario, drive);
  const std::vector<cv::Mat> images = renderDrive(drive);
  const DriveFigures figures = driveFigures(scenario, drive, runDrive(drive, images));
  std::printf("%s: RLE %.2f %%, scale %.2f %%, held %.2f, within 2 sigma %.2f, ok hidden %.2f\n",
              scenario.name.c_str(), figures.rle_percent, figures.scale_error_percent, figures.held,
              figures.within_2_sigma, figures.ok_while_hidden);
  EXPECT_EQ(violatedThreshold(figures, scenario.bars), "");
  expectRemedy(scenario, drive, images);
}

std::vector<Scenario> drivesToRun() {
  const std::vector<Scenario> all = allScenarios();
  std::vector<Scenario> some;
  for (std::size_t i = 0; i < all.size(); i += kEveryDrive) some.push_back(all[i]);
  return some;
}

INSTANTIATE_TEST_SUITE_P(Drives, ScenarioDrive, testing::ValuesIn(drivesToRun()),
                         [](const auto& drive) { return drive.param.name; });

}  // namespace
}  // namespace ground_scale_vo
