#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/simulation/scenario_evaluation.hpp"

namespace ground_scale_vo {

/// The metrics of one scenario, a row of the tables.
struct ScenarioRow {
  std::string name;
  ScenarioMetrics metrics;
};

/// A table with a row per scenario.
std::string scenariosMarkdown(const std::vector<ScenarioRow>& rows);

/// An object with the metrics; null for missing values.
nlohmann::ordered_json metricsJson(const ScenarioMetrics& metrics);

/// A JSON array with an object per scenario, which has its name as "drive".
std::string scenariosJson(const std::vector<ScenarioRow>& rows);

/// Heading and rows of the table on the terminal. seconds: computing time.
std::string terminalHeading();
std::string terminalRow(const ScenarioRow& row, double seconds);

/// "RLE % / held share / share within 2 sigma"; when a threshold is violated, in bold and followed
/// by its name, after a fourth number for the share of "ok while unobservable". Only "lost" or "no
/// scale" if no frame has a metric pose.
std::string ablationCell(const ScenarioMetrics& metrics, const ScenarioThresholds& thresholds);

/// metricsJson(), and the violated threshold as "violated"; "clearly": whether the doubled
/// thresholds are violated, too.
nlohmann::ordered_json ablationJson(const ScenarioMetrics& metrics,
                                    const ScenarioThresholds& thresholds);

/// The settings with which the scenario is run without the component that it depends on.
std::vector<std::string> settingsWithoutComponent(const ScenarioAblation& ablation);

}  // namespace ground_scale_vo
