#include "ground_scale_vo/simulation/scenarios.hpp"

#include <gtest/gtest.h>

#include <set>
#include <string>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

TEST(Scenarios, HaveUniqueNamesAndValidOptions) {
  std::set<std::string> names;
  for (const Scenario& scenario : allScenarios()) {
    EXPECT_TRUE(names.insert(scenario.name).second) << scenario.name;
    EXPECT_NO_THROW(scenario.options.validate()) << scenario.name;
    EXPECT_EQ(findScenario(scenario.name).description, scenario.description);
    if (!scenario.unobservable) continue;
    EXPECT_LE(scenario.unobservable->first, scenario.unobservable->last);
    EXPECT_LT(static_cast<int>(scenario.unobservable->last), scenario.options.frames);
  }
  try {
    findScenario("unknown_scenario");
    FAIL();
  } catch (const OptionError& error) {
    EXPECT_NE(std::string(error.what()).find("puddles"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace ground_scale_vo
