#include "tools/support/scenario_tables.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <tuple>

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

/// Metrics that violate no threshold.
ScenarioMetrics goodMetrics() {
  ScenarioMetrics m = scenarioMetrics();
  m.tracked_frames = 100;
  m.lost_events = 0;
  m.ok_while_unobservable = 0;
  return m;
}

TEST(ScenarioTables, AnAblationCellIsBoldWithTheNameOfAViolatedThreshold) {
  const ScenarioThresholds thresholds;
  ScenarioMetrics m = goodMetrics();
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

TEST(ScenarioTables, AnAblationIsViolatedClearlyBeyondTheDoubledThreshold) {
  for (const auto& [rle_percent, violated, clearly] :
       {std::tuple(1.0, "", false), std::tuple(2.0, "RLE", false), std::tuple(4.0, "RLE", true)}) {
    ScenarioMetrics m = goodMetrics();
    m.rle_percent = rle_percent;
    const auto json = ablationJson(m, {});  // at most 1.5 %
    EXPECT_EQ(json.at("violated"), violated);
    EXPECT_EQ(json.at("clearly"), clearly);
    EXPECT_EQ(json.at("rle_percent"), rle_percent);
  }
}

}  // namespace
}  // namespace ground_scale_vo
