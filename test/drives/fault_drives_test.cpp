// The pipeline on the rendered drives with a fault of the camera or an obstacle, against exact
// ground truth.

#include <gtest/gtest.h>

#include <ostream>
#include <string>
#include <vector>

#include "simulation/scenario_evaluation.hpp"
#include "simulation/scenarios.hpp"

namespace gsv {

void PrintTo(const Scenario& scenario, std::ostream* stream) { *stream << scenario.name; }

namespace {

class FaultDrive : public testing::TestWithParam<Scenario> {};

TEST_P(FaultDrive, MeetsItsThresholds) {
  const Scenario& scenario = GetParam();
  const SyntheticDrive drive(scenario.options);
  const ScenarioMetrics metrics =
      evaluateScenario(scenario, drive, runDrive(drive, renderDrive(drive)));
  EXPECT_EQ(violatedThreshold(metrics, scenario.thresholds), "");
}

INSTANTIATE_TEST_SUITE_P(Drives, FaultDrive, testing::ValuesIn(faultScenarios()),
                         [](const auto& drive) { return drive.param.name; });

}  // namespace
}  // namespace gsv
