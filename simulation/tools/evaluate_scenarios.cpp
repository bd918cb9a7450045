// Renders the drives of the scenario catalogue and evaluates the pipeline on each.

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/files.hpp"
#include "common/text.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "simulation/scenario_evaluation.hpp"
#include "simulation/scenarios.hpp"
#include "simulation/speed_sensor.hpp"
#include "tools/support/command_line.hpp"
#include "tools/support/parallel_for.hpp"

namespace {

using Json = nlohmann::ordered_json;
using Settings = std::vector<std::string>;

constexpr const char* kFaults = "faults";  // the name of all drives with a fault

constexpr const char* kDetails =
    R"(Without a NAME: all scenarios but the faults. The trajectory errors are computed from the first
metric pose on. metric: frames from the first metric pose on; RLE: relative error of the path length;
t_err short: the devkit's translation error, over 10, 20 ... 80 m; rotation: error of the rotation from
the first to the last image; displacement sigma: error of the displacement from the first metric pose to
the last frame, along it, over its published standard deviation; scale: median absolute scale error, the
true scale being computed over at least 2 m of ground truth; held: share of frames without a scale
measurement of their own (HELD), from the first metric pose on; 2 sigma: share of frames whose true
scale lies within two reported sigma; ok unobservable: share of the frames with unobservable scale
(no road texture, hidden road, or standstill) that are reported as OK, which should be 0.
recovery: frames after a fault until a metric pose with a measured scale again, -1: never; error
afterwards: of the position, from 3 s and 20 m after the fault to the end, relative to the path length.

The last column is the violated threshold: lost, late scale (no metric pose in the first half), rotation
(error above 2 degrees), RLE (above 1.5 %), 2 sigma (below 0.75), ok while unobservable, no recovery,
error after the fault (above 5 %). Some scenarios have other thresholds.

--ablation runs each scenario several times: with the defaults, with the paper's equations and
thresholds unmodified, with feature-based measurements only, with direct measurements only, and with
the component that this scenario depends on disabled.

--speed runs each scenario also with a speed at 10 Hz with a noise of 0.5 %: with the camera height, alone,
and with the camera height and a fault. slip, stuck, zero and gap begin in the middle of the drive and, but
for stuck and zero, last 2 s; sign, late (0.2 s) and unit (km/h) are those of the whole drive.

Exit status: 0 success, 1 runtime error, 2 invalid arguments.)";

struct Arguments {
  std::vector<std::string> names;
  std::vector<gsv::Scenario> scenarios;
  std::string out;
  int threads = 1;
  bool ablation = false, speed = false;
  int seed = 1;
  std::string paper;  ///< file with options
  Settings settings;  ///< of --set
};

/// A metric: column heading in the table, key in the JSON file, number of decimals in both.
struct Column {
  const char *heading, *key;
  int decimals;
  double (*value)(const gsv::ScenarioMetrics&);
};
using Metrics = gsv::ScenarioMetrics;
constexpr Column kColumns[] = {
    {"frames", "frames", 0, [](const Metrics& m) { return static_cast<double>(m.frames); }},
    {"tracked", "tracked_frames", 0,
     [](const Metrics& m) { return static_cast<double>(m.tracked_frames); }},
    {"lost", "lost_events", 0, [](const Metrics& m) { return static_cast<double>(m.lost_events); }},
    {"metric", "metric_frames", 0,
     [](const Metrics& m) { return static_cast<double>(m.metric_frames); }},
    {"RLE %", "rle_percent", 2, [](const Metrics& m) { return m.rle_percent; }},
    {"t_err short %", "t_err_short_percent", 2,
     [](const Metrics& m) { return m.t_err_short_percent; }},
    {"rotation deg", "rotation_error_deg", 2,
     [](const Metrics& m) { return m.rotation_error_deg; }},
    {"displacement sigma", "displacement_sigmas", 2,
     [](const Metrics& m) { return m.displacement_sigmas; }},
    {"scale %", "scale_error_percent", 2, [](const Metrics& m) { return m.scale_error_percent; }},
    {"held", "held", 2, [](const Metrics& m) { return m.held_share; }},
    {"2 sigma", "within_2_sigma", 2, [](const Metrics& m) { return m.within_2_sigma; }},
    {"ok unobservable", "ok_while_unobservable", 2,
     [](const Metrics& m) { return m.ok_while_unobservable; }},
    {"recovery", "recovery_frames", 0,
     [](const Metrics& m) { return static_cast<double>(m.recovery_frames); }},
    {"error afterwards %", "error_after_fault_percent", 2,
     [](const Metrics& m) { return m.error_after_fault_percent; }},
};

std::string tableHeading() {
  std::string text = "| drive |", rule = "|---|";
  for (const Column& column : kColumns) {
    text += std::string(" ") + column.heading + " |";
    rule += "---|";
  }
  return text + " violated |\n" + rule + "---|\n";
}

/// The metric as text; `none` if it is not finite.
std::string number(const Column& column, const Metrics& metrics, const char* none) {
  const double value = column.value(metrics);
  return std::isfinite(value) ? gsv::format("%.*f", column.decimals, value) : none;
}

std::string tableRow(const std::string& name, const Metrics& metrics, const std::string& violated) {
  std::string text = "| " + name + " |";
  for (const Column& column : kColumns) text += " " + number(column, metrics, "–") + " |";
  return text + " " + violated + " |\n";
}

Json json(const Metrics& metrics, const gsv::ScenarioThresholds& thresholds) {
  Json object;
  for (const Column& column : kColumns) {
    object[column.key] = Json::parse(number(column, metrics, "null"));
  }
  object["violated"] = gsv::violatedThreshold(metrics, thresholds);
  return object;
}

/// One run over a scenario.
struct Variant {
  std::string key;  ///< of the JSON file
  Settings settings;
  std::optional<gsv::SpeedFault> speed;  ///< of the sensor; empty: there is none
  bool camera_height = true;             ///< is known
};

std::vector<Variant> variants(const gsv::Scenario& scenario, const Arguments& arguments) {
  std::vector<Variant> all = {{"default", {}, {}}};
  if (arguments.ablation) {
    if (!arguments.paper.empty()) all.push_back({"paper", gsv::readOptions(arguments.paper), {}});
    all.push_back({"features_only", {gsv::kFeatureBasedOnly}, {}});
    all.push_back({"direct_only", {gsv::kDirectOnly}, {}});
    const gsv::ScenarioAblation& component = scenario.ablation;
    if (!component.disable.empty()) {
      Settings without = component.base;
      without.insert(without.end(), component.disable.begin(), component.disable.end());
      all.push_back({"disabled", without, {}});
    }
  }
  if (arguments.speed) {
    all.push_back({"speed_alone", {}, gsv::SpeedFault::kNone, false});
    all.push_back({"speed", {}, gsv::SpeedFault::kNone});
    for (const auto& [name, fault] : gsv::kSpeedFaults) all.push_back({"speed_" + name, {}, fault});
  }
  return all;
}

void check(Arguments* arguments) {
  arguments->settings.insert(arguments->settings.begin(),
                             "random_seed=" + std::to_string(arguments->seed));
  for (const std::string& setting : arguments->settings) {
    gsv::OfflineRun::Options options;
    gsv::setOption(options, setting);  // an invalid assignment fails before the runs
  }
  if (arguments->names.empty()) arguments->scenarios = gsv::allScenarios();
  for (const std::string& name : arguments->names) {
    if (name != kFaults) {
      arguments->scenarios.push_back(gsv::findScenario(name));
      continue;
    }
    for (const gsv::Scenario& scenario : gsv::faultScenarios()) {
      arguments->scenarios.push_back(scenario);
    }
  }
  for (gsv::Scenario& scenario : arguments->scenarios) {
    scenario.options.noise_seed = static_cast<std::uint64_t>(arguments->seed);
  }
}

int run(const Arguments& arguments) {
  cv::setNumThreads(1);
  const std::filesystem::path out(arguments.out);
  gsv::makeFolder(arguments.out);  // fails before the runs, not after them
  std::size_t runs = 0;
  for (const gsv::Scenario& scenario : arguments.scenarios) {
    runs += variants(scenario, arguments).size();
  }
  gsv::ProgressLine progress("evaluate_scenarios", runs);
  std::vector<Json> entries(arguments.scenarios.size());
  std::vector<std::string> rows(entries.size());
  gsv::parallelFor(entries.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::SyntheticDrive drive(scenario.options);
    const std::vector<cv::Mat> rendered = gsv::renderDrive(drive);
    entries[i] = {{"drive", scenario.name}, {"component", scenario.ablation.component}};
    for (const Variant& variant : variants(scenario, arguments)) {
      Settings all = arguments.settings;
      all.insert(all.end(), variant.settings.begin(), variant.settings.end());
      gsv::KnownLengths known{variant.camera_height, {}};
      if (variant.speed) known.speeds = gsv::simulateSpeeds(drive, *variant.speed);
      const gsv::RunRecord record = gsv::runDrive(drive, rendered, all, known);
      const bool is_default = variant.key == "default";
      if (is_default) {
        gsv::writeRun(out / scenario.name, record, drive.cameraHeight(), groundTruth(drive),
                      groundTruthHeights(drive));
      }
      const Metrics metrics = gsv::evaluateScenario(scenario, drive, record);
      entries[i][variant.key] = json(metrics, scenario.thresholds);
      const std::string name = scenario.name + (is_default ? "" : " " + variant.key);
      progress.step("runs");
      rows[i] += tableRow(name, metrics, gsv::violatedThreshold(metrics, scenario.thresholds));
    }
  });
  std::fputs(tableHeading().c_str(), stdout);
  for (const std::string& row : rows) std::fputs(row.c_str(), stdout);
  gsv::writeFile(out / "scenarios.json", Json(entries).dump(2) + "\n");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line("evaluate_scenarios",
                                "Renders drives of the scenario catalogue with exact ground truth, "
                                "runs the odometry over them\n"
                                "and prints a table of its errors.",
                                kDetails);
  command_line.addPositionals("NAME",
                              "scenario (render_drive --list); \"faults\": all drives with a fault",
                              &arguments.names);
  command_line.options().add_options()  //
      ("out", gsv::requiredValue(&arguments.out, "DIR"),
       "output folder for scenarios.json, and DIR/NAME/ with the files of run_sequence")  //
      ("ablation", gsv::po::bool_switch(&arguments.ablation),
       "run each scenario also with components disabled")  //
      ("paper", gsv::optionalValue(&arguments.paper, "FILE"),
       "with --ablation: options of another run, config/paper.yaml")  //
      ("speed", gsv::po::bool_switch(&arguments.speed),
       "run each scenario also with a sensor of the speed, and its faults")  //
      ("seed", gsv::numberInRange("--seed", &arguments.seed, "N", 1, 1000000),
       "another one: the same drives with other sensor noise and another random_seed")  //
      ("threads", gsv::numberInRange("--threads", &arguments.threads, "N", 1, 256),
       "drives rendered and run in parallel")  //
      ("set", gsv::settingsValue(&arguments.settings), gsv::kSettingsHelp);
  return command_line.run(
      argc, argv, [&] { check(&arguments); }, [&] { return run(arguments); });
}
