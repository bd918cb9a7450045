#include "scenario_tables.hpp"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

namespace ground_scale_vo {
namespace {

/// A metric: column heading in the tables, key in the JSON file, number of decimals in both.
struct Column {
  const char *heading, *key;
  int decimals;
  double (*value)(const ScenarioMetrics&);
};
constexpr Column kColumns[] = {
    {"frames", "frames", 0, [](const ScenarioMetrics& m) { return static_cast<double>(m.frames); }},
    {"tracked", "tracked_frames", 0,
     [](const ScenarioMetrics& m) { return static_cast<double>(m.tracked_frames); }},
    {"lost", "lost_events", 0,
     [](const ScenarioMetrics& m) { return static_cast<double>(m.lost_events); }},
    {"metric", "metric_frames", 0,
     [](const ScenarioMetrics& m) { return static_cast<double>(m.metric_frames); }},
    {"RLE %", "rle_percent", 2, [](const ScenarioMetrics& m) { return m.rle_percent; }},
    {"t_err short %", "t_err_short_percent", 2,
     [](const ScenarioMetrics& m) { return m.t_err_short_percent; }},
    {"rotation deg", "rotation_error_deg", 2,
     [](const ScenarioMetrics& m) { return m.rotation_error_deg; }},
    {"displacement sigma", "displacement_sigmas", 2,
     [](const ScenarioMetrics& m) { return m.displacement_sigmas; }},
    {"scale %", "scale_error_percent", 2,
     [](const ScenarioMetrics& m) { return m.scale_error_percent; }},
    {"held", "held", 2, [](const ScenarioMetrics& m) { return m.held_share; }},
    {"2 sigma", "within_2_sigma", 2, [](const ScenarioMetrics& m) { return m.within_2_sigma; }},
    {"ok unobservable", "ok_while_unobservable", 2,
     [](const ScenarioMetrics& m) { return m.ok_while_unobservable; }},
};

/// The metric as text; `none` if it is not finite.
std::string number(const Column& column, const ScenarioMetrics& metrics, const char* none) {
  const double value = column.value(metrics);
  if (!std::isfinite(value)) return none;
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", column.decimals, value);
  return text;
}

}  // namespace

std::string scenariosMarkdown(const std::vector<ScenarioRow>& rows) {
  std::string text = "| drive |", rule = "|---|";
  for (const Column& column : kColumns) {
    text += std::string(" ") + column.heading + " |";
    rule += "---|";
  }
  text += "\n" + rule + "\n";
  for (const ScenarioRow& row : rows) {
    text += "| " + row.name + " |";
    for (const Column& column : kColumns) text += " " + number(column, row.metrics, "–") + " |";
    text += "\n";
  }
  return text;
}

nlohmann::ordered_json metricsJson(const ScenarioMetrics& metrics) {
  nlohmann::ordered_json object;
  for (const Column& column : kColumns) {
    object[column.key] = nlohmann::ordered_json::parse(number(column, metrics, "null"));
  }
  return object;
}

std::string scenariosJson(const std::vector<ScenarioRow>& rows) {
  nlohmann::ordered_json drives = nlohmann::ordered_json::array();
  for (const ScenarioRow& row : rows) {
    nlohmann::ordered_json drive;
    drive["drive"] = row.name;
    drive.update(metricsJson(row.metrics));
    drives.push_back(drive);
  }
  return drives.dump(2) + "\n";
}

std::string terminalHeading() {
  char text[32];
  std::snprintf(text, sizeof text, "%-18s", "drive");
  std::string line = text;
  for (const Column& column : kColumns) line += std::string("  ") + column.heading;
  return line + "  seconds\n";
}

std::string terminalRow(const ScenarioRow& row, double seconds) {
  char text[64];
  std::snprintf(text, sizeof text, "%-18s", row.name.c_str());
  std::string line = text;
  for (const Column& column : kColumns) {
    const auto width = static_cast<int>(std::strlen(column.heading)) + 2;
    std::snprintf(text, sizeof text, "%*s", width, number(column, row.metrics, "-").c_str());
    line += text;
  }
  std::snprintf(text, sizeof text, "%9.1f\n", seconds);
  return line + text;
}

std::string ablationCell(const ScenarioMetrics& metrics, const ScenarioThresholds& thresholds) {
  const std::string violated = violatedThreshold(metrics, thresholds);
  if (metrics.metric_frames == 0) return violated == "lost" ? "**lost**" : "**no scale**";
  char text[64];
  std::snprintf(text, sizeof text, "%.2f / %.2f / %.2f", metrics.rle_percent, metrics.held_share,
                metrics.within_2_sigma);
  if (violated.empty()) return text;
  if (violated == "ok while unobservable") {
    std::snprintf(text + std::strlen(text), sizeof text - std::strlen(text), " / %.2f",
                  metrics.ok_while_unobservable);
  }
  return std::string("**") + text + "** " + violated;
}

nlohmann::ordered_json ablationJson(const ScenarioMetrics& metrics,
                                    const ScenarioThresholds& thresholds) {
  nlohmann::ordered_json object = metricsJson(metrics);
  object["violated"] = violatedThreshold(metrics, thresholds);
  object["clearly"] = !violatedThreshold(metrics, doubled(thresholds)).empty();
  return object;
}

std::vector<std::string> settingsWithoutComponent(const ScenarioAblation& ablation) {
  std::vector<std::string> settings = ablation.base;
  settings.insert(settings.end(), ablation.disable.begin(), ablation.disable.end());
  return settings;
}

}  // namespace ground_scale_vo
