// Renders the drives of the scenario catalogue and evaluates the pipeline on each.

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/files.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/simulation/scenario_evaluation.hpp"
#include "ground_scale_vo/simulation/scenarios.hpp"
#include "support/command_line.hpp"
#include "support/parallel_for.hpp"
#include "support/scenario_tables.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kDetails =
    R"(Without a NAME: all scenarios. The trajectory errors are computed from the first metric pose on.
metric: frames from the first metric pose on; RLE: relative error of the path length; t_err short:
the devkit's translation error, over 10, 20 ... 80 m; scale: median absolute scale error, the true
scale being computed over at least 2 m of ground truth; held: share of frames without a scale
measurement of their own (HELD), from the first metric pose on; 2 sigma: share of frames whose true
scale lies within two reported sigma; ok unobservable: share of the frames with unobservable scale
(no road texture, or standstill) that are reported as OK, which should be 0. rotation: error of the
rotation from the first to the last image; displacement sigma: error of the displacement from the first
metric pose to the last frame, along it, over its published standard deviation.

--ablation runs each scenario several times: with the defaults, with the paper's equations and
thresholds unmodified, with feature-based measurements only, with direct measurements only, and with
the component that this scenario depends on disabled. A cell of its table is RLE % / held / 2 sigma,
bold where a threshold is violated, followed by its name: lost, late scale (no metric pose in the
first half), rotation (error above 2 degrees), RLE (above 1.5 %), 2 sigma (below 0.75), ok while
unobservable. Some scenarios have other thresholds. no scale: no metric pose at all.

Exit status: 0 success, 1 runtime error, 2 invalid arguments.)";

struct Arguments {
  std::vector<std::string> names;
  std::vector<gsv::Scenario> scenarios;
  std::string out;
  int threads = 1;
  bool ablation = false;
  std::vector<std::string> settings;  ///< of --set
};

std::size_t frames(const gsv::Scenario& scenario) {
  return static_cast<std::size_t>(scenario.options.frames);
}

void writeRun(const std::filesystem::path& folder, const gsv::SyntheticDrive& drive,
              const gsv::RunRecord& record) {
  std::vector<Eigen::Isometry3d> ground_truth;
  std::vector<double> heights;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    ground_truth.push_back(drive.frame(i).T_c0_c);
    heights.push_back(drive.frame(i).height);
  }
  gsv::writeRun(folder, record, drive.cameraHeight(), ground_truth, heights);
}

void tabulate(const Arguments& arguments) {
  std::fputs(gsv::terminalHeading().c_str(), stdout);
  std::vector<gsv::ScenarioRow> rows(arguments.scenarios.size());
  std::size_t steps = 0;  // each image counts once when rendered and once in each run
  for (const gsv::Scenario& scenario : arguments.scenarios) steps += 2 * frames(scenario);
  gsv::ProgressLine progress("evaluate_scenarios", steps);
  const auto step = [&progress] { progress.step("steps"); };
  gsv::parallelFor(rows.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::Stopwatch watch;
    const gsv::SyntheticDrive drive(scenario.options);
    const gsv::RunRecord record =
        gsv::runDrive(drive, gsv::renderDrive(drive, step), arguments.settings, step);
    rows[i] = {scenario.name, gsv::evaluateScenario(scenario, drive, record)};
    writeRun(std::filesystem::path(arguments.out) / scenario.name, drive, record);
    progress.pause([&] { std::fputs(gsv::terminalRow(rows[i], watch.seconds()).c_str(), stdout); });
  });
  const std::filesystem::path out(arguments.out);
  gsv::writeFile(out / "scenarios.md", gsv::scenariosMarkdown(rows));
  gsv::writeFile(out / "scenarios.json", gsv::scenariosJson(rows));
}

using Settings = std::vector<std::string>;

/// Settings with which every scenario is run, a column of the table and a key of the JSON file.
struct Variant {
  const char *heading, *key;
  Settings settings;
};

std::vector<Variant> variants() {
  return {{"default", "default", {}},
          {"the paper as printed", "paper", {"paper_literal=true"}},
          {"feature-based only", "features_only", {gsv::kFeatureBasedOnly}},
          {"direct only", "direct_only", {gsv::kDirectOnly}}};
}

std::string asMarkdownCode(const Settings& settings) {
  std::string text;
  for (const std::string& setting : settings) {
    text += (text.empty() ? "`" : ", `") + setting + "`";
  }
  return text;
}

void tabulateAblation(const Arguments& arguments) {
  std::string text = "| drive | component |", separator = "|---|---|";
  for (const Variant& variant : variants()) {
    text += std::string(" ") + variant.heading + " |";
    separator += "---|";
  }
  text += " component disabled | options |\n" + separator + "---|---|\n";
  std::fputs(text.c_str(), stdout);
  std::vector<std::string> lines(arguments.scenarios.size());
  std::vector<nlohmann::ordered_json> entries(lines.size());
  std::size_t steps = 0;  // each image counts once when rendered and once in each run
  for (const gsv::Scenario& scenario : arguments.scenarios) {
    const std::size_t runs = variants().size() + !scenario.ablation.disable.empty();
    steps += (1 + runs) * frames(scenario);
  }
  gsv::ProgressLine progress("evaluate_scenarios", steps);
  const auto step = [&progress] { progress.step("steps"); };
  gsv::parallelFor(lines.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::ScenarioAblation& ablation = scenario.ablation;
    const gsv::SyntheticDrive drive(scenario.options);
    const std::vector<cv::Mat> rendered = gsv::renderDrive(drive, step);
    nlohmann::ordered_json& entry = entries[i];
    entry = {{"drive", scenario.name}, {"component", ablation.component}};
    const auto run = [&](const char* key, const Settings& settings) {
      Settings all = arguments.settings;
      all.insert(all.end(), settings.begin(), settings.end());
      const gsv::ScenarioMetrics metrics =
          gsv::evaluateScenario(scenario, drive, gsv::runDrive(drive, rendered, all, step));
      entry[key] = gsv::ablationJson(metrics, scenario.thresholds);
      return gsv::ablationCell(metrics, scenario.thresholds);
    };
    std::string& line = lines[i];
    line = "| " + scenario.name + " | " + ablation.component + " |";
    for (const Variant& variant : variants()) {
      line += " " + run(variant.key, variant.settings) + " |";
    }
    const Settings without = gsv::settingsWithoutComponent(ablation);
    line += ablation.disable.empty()
                ? " | |"
                : " " + run("disabled", without) + " | " + asMarkdownCode(without) + " |";
    line += "\n";
    progress.pause([&] { std::fputs(line.c_str(), stdout); });
  });
  for (const std::string& line : lines) text += line;
  const std::filesystem::path out(arguments.out);
  gsv::writeFile(out / "ablation.md", text);
  gsv::writeFile(out / "ablation.json", nlohmann::ordered_json(entries).dump(2) + "\n");
}

void check(Arguments* arguments) {
  for (const std::string& setting : arguments->settings) {
    gsv::OfflineRun::Options options;
    gsv::setOption(options, setting);  // an invalid assignment fails before the runs
  }
  for (const std::string& name : arguments->names) {
    arguments->scenarios.push_back(gsv::findScenario(name));
  }
  if (arguments->scenarios.empty()) arguments->scenarios = gsv::allScenarios();
}

void run(const Arguments& arguments) {
  cv::setNumThreads(1);
  gsv::makeFolder(arguments.out);  // fails before the runs, not after them
  if (arguments.ablation) {
    tabulateAblation(arguments);
  } else {
    tabulate(arguments);
  }
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line("evaluate_scenarios",
                                "Renders drives of the scenario catalogue with exact ground truth, "
                                "runs the odometry over them\n"
                                "and prints tables of its errors.",
                                kDetails);
  command_line.addPositionals("NAME", "scenario (render_drive --list)", &arguments.names);
  command_line.options().add_options()  //
      ("out", gsv::requiredValue(&arguments.out, "DIR"),
       "output folder for scenarios.md, scenarios.json and DIR/NAME/ with the files of "
       "run_sequence; or "
       "for ablation.md and ablation.json")  //
      ("ablation", gsv::po::bool_switch(&arguments.ablation),
       "run each scenario also with components disabled")  //
      ("threads", gsv::numberInRange("--threads", &arguments.threads, "N", 1, 256),
       "drives rendered and run in parallel")  //
      ("set", gsv::settingsValue(&arguments.settings), gsv::kSettingsHelp);
  return command_line.run(
      argc, argv, [&] { check(&arguments); },
      [&] {
        run(arguments);
        return 0;
      });
}
