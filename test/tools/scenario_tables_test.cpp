#include "tools/support/scenario_tables.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

namespace ground_scale_vo {
namespace {

/// Each value differs from the others.
ScenarioMetrics scenarioMetrics() {
  ScenarioMetrics m;
  m.frames = 100;
  m.tracked_frames = 99;
  m.lost_events = 1;
  m.metric_frames = 90;
  m.rle_percent = 0.5;
  m.t_err_short_percent = 1.25;
  m.rotation_error_deg = 0.75;
  m.displacement_sigmas = 1.5;
  m.scale_error_percent = 0.25;
  m.held_share = 0.1;
  m.within_2_sigma = 0.95;
  m.ok_while_unobservable = 0.05;
  return m;
}

TEST(ScenarioTables, EachKeyHasItsValue) {
  const nlohmann::json expected = {{"frames", 100},
                                   {"tracked_frames", 99},
                                   {"lost_events", 1},
                                   {"metric_frames", 90},
                                   {"rle_percent", 0.5},
                                   {"t_err_short_percent", 1.25},
                                   {"rotation_error_deg", 0.75},
                                   {"displacement_sigmas", 1.5},
                                   {"scale_error_percent", 0.25},
                                   {"held", 0.1},
                                   {"within_2_sigma", 0.95},
                                   {"ok_while_unobservable", 0.05}};
  EXPECT_EQ(nlohmann::json::parse(metricsJson(scenarioMetrics()).dump()), expected);
  ScenarioMetrics unknown;
  unknown.rle_percent = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(metricsJson(unknown).at("rle_percent").is_null());
  const auto drives =
      nlohmann::json::parse(scenariosJson({{"a", scenarioMetrics()}, {"b", unknown}}));
  EXPECT_EQ(drives.at(0).at("drive"), "a");
  EXPECT_EQ(drives.at(1).at("frames"), 0);
}

TEST(ScenarioTables, HaveTheColumnsInTheOrderOfTheHeading) {
  EXPECT_EQ(scenariosMarkdown({{"a", scenarioMetrics()}}),
            "| drive | frames | tracked | lost | metric | RLE % | t_err short % | rotation deg | "
            "displacement sigma | scale % | held | 2 sigma | ok unobservable |\n"
            "|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
            "| a | 100 | 99 | 1 | 90 | 0.50 | 1.25 | 0.75 | 1.50 | 0.25 | 0.10 | 0.95 | 0.05 |\n");
  EXPECT_EQ(terminalHeading().size(), terminalRow({"a", scenarioMetrics()}, 7).size());
}

TEST(AblationCell, IsBoldWithTheNameOfAViolatedThreshold) {
  const ScenarioThresholds thresholds;
  ScenarioMetrics m = scenarioMetrics();
  m.tracked_frames = 100;
  m.lost_events = 0;
  m.ok_while_unobservable = 0;
  EXPECT_EQ(ablationCell(m, thresholds), "0.50 / 0.10 / 0.95");
  m.rle_percent = 3;
  EXPECT_EQ(ablationCell(m, thresholds), "**3.00 / 0.10 / 0.95** RLE");
  ScenarioThresholds wide;
  wide.max_rle_percent = 4;
  EXPECT_EQ(ablationCell(m, wide), "3.00 / 0.10 / 0.95");
  m.ok_while_unobservable = 1;
  EXPECT_EQ(ablationCell(m, wide), "**3.00 / 0.10 / 0.95 / 1.00** ok while unobservable");
  m.metric_frames = 0;
  EXPECT_EQ(ablationCell(m, wide), "**no scale**");
  m.tracked_frames = 0;
  EXPECT_EQ(ablationCell(m, wide), "**lost**");
}

TEST(AblationJson, HasTheViolatedThresholdAndWhetherItIsViolatedClearly) {
  ScenarioMetrics m = scenarioMetrics();
  m.tracked_frames = 100;
  m.lost_events = 0;
  m.ok_while_unobservable = 0;
  const auto json = [&](double rle_percent) {
    m.rle_percent = rle_percent;
    return ablationJson(m, {});  // at most 1.5 %
  };
  EXPECT_EQ(json(1).at("violated"), "");
  EXPECT_EQ(json(1).at("clearly"), false);
  EXPECT_EQ(json(2).at("violated"), "RLE");
  EXPECT_EQ(json(2).at("clearly"), false);
  EXPECT_EQ(json(4).at("violated"), "RLE");
  EXPECT_EQ(json(4).at("clearly"), true);
  EXPECT_EQ(json(4).at("rle_percent"), 4);
  EXPECT_EQ(json(4).at("held"), 0.1);
}

TEST(SettingsWithoutComponent, BeginWithThoseThatMeetTheThresholds) {
  EXPECT_EQ(settingsWithoutComponent({"c", {"a=1"}, {"b=2", "c=3"}}),
            (std::vector<std::string>{"a=1", "b=2", "c=3"}));
}

}  // namespace
}  // namespace ground_scale_vo
