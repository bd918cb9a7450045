#include "scenario_tables.hpp"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

namespace ground_scale_vo {
namespace {

/// A column of the tables: heading, key in the JSON file, number of decimals.
struct Column {
  const char *heading, *key;
  int decimals;
  double (*value)(const DriveFigures&);
};
using Figures = DriveFigures;
constexpr Column kColumns[] = {
    {"frames", "frames", 0, [](const Figures& f) { return static_cast<double>(f.frames); }},
    {"tracked", "tracked_frames", 0,
     [](const Figures& f) { return static_cast<double>(f.tracked_frames); }},
    {"lost", "lost_events", 0, [](const Figures& f) { return static_cast<double>(f.lost_events); }},
    {"metric", "metric_frames", 0,
     [](const Figures& f) { return static_cast<double>(f.metric_frames); }},
    {"RLE %", "rle_percent", 2, [](const Figures& f) { return f.rle_percent; }},
    {"t_err short %", "t_err_short_percent", 2,
     [](const Figures& f) { return f.t_err_short_percent; }},
    {"scale %", "scale_error_percent", 2, [](const Figures& f) { return f.scale_error_percent; }},
    {"held", "held", 2, [](const Figures& f) { return f.held; }},
    {"2 sigma", "within_2_sigma", 2, [](const Figures& f) { return f.within_2_sigma; }},
    {"ok hidden", "ok_while_hidden", 2, [](const Figures& f) { return f.ok_while_hidden; }},
};

std::string number(const Column& column, const Figures& figures, const char* none) {
  const double value = column.value(figures);
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
    for (const Column& column : kColumns) text += " " + number(column, row.figures, "–") + " |";
    text += "\n";
  }
  return text;
}

std::string scenariosJson(const std::vector<ScenarioRow>& rows) {
  nlohmann::ordered_json drives = nlohmann::ordered_json::array();
  for (const ScenarioRow& row : rows) {
    nlohmann::ordered_json drive;
    drive["drive"] = row.name;
    for (const Column& column : kColumns) {
      drive[column.key] = nlohmann::ordered_json::parse(number(column, row.figures, "null"));
    }
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
    std::snprintf(text, sizeof text, "%*s", width, number(column, row.figures, "-").c_str());
    line += text;
  }
  std::snprintf(text, sizeof text, "%9.1f\n", seconds);
  return line + text;
}

std::string ablationCell(const DriveFigures& figures, const DriveThresholds& thresholds) {
  const std::string violated = violatedThreshold(figures, thresholds);
  if (figures.metric_frames == 0) return violated == "lost" ? "**lost**" : "**no start**";
  char text[64];
  std::snprintf(text, sizeof text, "%.2f / %.2f / %.2f", figures.rle_percent, figures.held,
                figures.within_2_sigma);
  if (violated.empty()) return text;
  if (violated == "ok hidden") {
    std::snprintf(text + std::strlen(text), sizeof text - std::strlen(text), " / %.2f",
                  figures.ok_while_hidden);
  }
  return std::string("**") + text + "** " + violated;
}

}  // namespace ground_scale_vo
