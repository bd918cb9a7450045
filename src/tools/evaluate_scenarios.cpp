// Renders the drives of the scenario catalogue and evaluates the pipeline on each.

#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/simulation/scenario_evaluation.hpp"
#include "ground_scale_vo/simulation/scenarios.hpp"
#include "support/command_line.hpp"
#include "support/parallel_for.hpp"
#include "support/progress_line.hpp"
#include "support/scenario_tables.hpp"
#include "support/sequence_arguments.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kDetails =
    R"(Without a NAME: all scenarios. Metrics are computed from the first metric pose on. RLE: relative
error of the path length; t_err short: the devkit's error over 10, 20 ... 80 m; scale: median error of
the scale against that of 2 m of ground truth; held: share of frames without a measurement of their
own; 2 sigma: share of frames whose true scale lies within two reported sigma; ok hidden: share of
frames reported as measured although no road texture is visible, which should be 0.

--ablation runs each drive several times: with the defaults, with the paper's choices as printed, with
feature-based measurements only, with direct measurements only, and without the part that handles this
scenario. A cell of its table is RLE % / held / 2 sigma, bold where a threshold is violated, with the
reason: lost, no start in the first half, RLE above 1.5 %, 2 sigma below 0.75, ok hidden.

Exit status: 0 done, 1 DIR cannot be written, 2 the arguments cannot be used.)";

struct Arguments {
  std::vector<std::string> names;
  std::vector<gsv::Scenario> scenarios;
  std::string out;
  int threads = 1;
  bool ablation = false;
  std::vector<std::string> settings;  ///< of setOption()
};

std::size_t frames(const gsv::Scenario& scenario) {
  return static_cast<std::size_t>(scenario.options.frames);
}

void tabulate(const Arguments& arguments) {
  std::fputs(gsv::terminalHeading().c_str(), stdout);
  std::vector<gsv::ScenarioRow> rows(arguments.scenarios.size());
  std::size_t images = 0;  // rendered, and again for each run over them
  for (const gsv::Scenario& scenario : arguments.scenarios) images += 2 * frames(scenario);
  gsv::ProgressLine progress("evaluate_scenarios", images);
  const auto step = [&progress] { progress.step("images"); };
  gsv::parallelFor(rows.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::Stopwatch watch;
    const gsv::SyntheticDrive drive(scenario.options);
    const gsv::RunRecord record =
        gsv::runDrive(drive, gsv::renderDrive(drive, step), arguments.settings, step);
    rows[i] = {scenario.name, gsv::evaluateScenario(scenario, drive, record)};
    progress.pause([&] { std::fputs(gsv::terminalRow(rows[i], watch.seconds()).c_str(), stdout); });
  });
  const std::filesystem::path out(arguments.out);
  gsv::writeFile(out / "scenarios.md", gsv::scenariosMarkdown(rows));
  gsv::writeFile(out / "scenarios.json", gsv::scenariosJson(rows));
}

using Settings = std::vector<std::string>;

/// A configuration in which every drive is run.
struct Variant {
  const char* heading;
  Settings settings;
};

std::vector<Variant> variants() {
  return {{"default", {}},
          {"the paper as printed", {"paper_literal=true"}},
          {"feature-based only", {gsv::kFeatureBasedOnly}},
          {"direct only", {gsv::kDirectOnly}}};
}

std::string code(const Settings& settings) {
  std::string text;
  for (const std::string& setting : settings) {
    text += (text.empty() ? "`" : ", `") + setting + "`";
  }
  return text;
}

void tabulateAblation(const Arguments& arguments) {
  std::string text = "| drive | handled by |", rule = "|---|---|";
  for (const Variant& variant : variants()) {
    text += std::string(" ") + variant.heading + " |";
    rule += "---|";
  }
  text += " without it | options |\n" + rule + "---|---|\n";
  std::fputs(text.c_str(), stdout);
  std::vector<std::string> lines(arguments.scenarios.size());
  std::size_t images = 0;  // rendered, and again for each run over them
  for (const gsv::Scenario& scenario : arguments.scenarios) {
    const std::size_t runs = variants().size() + !scenario.ablation.disable.empty();
    images += (1 + runs) * frames(scenario);
  }
  gsv::ProgressLine progress("evaluate_scenarios", images);
  const auto step = [&progress] { progress.step("images"); };
  gsv::parallelFor(lines.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::ScenarioAblation& ablation = scenario.ablation;
    const gsv::SyntheticDrive drive(scenario.options);
    const std::vector<cv::Mat> rendered = gsv::renderDrive(drive, step);
    const auto run = [&](const Settings& settings) {
      Settings all = arguments.settings;
      all.insert(all.end(), settings.begin(), settings.end());
      return gsv::ablationCell(
          gsv::evaluateScenario(scenario, drive, gsv::runDrive(drive, rendered, all, step)),
          scenario.thresholds);
    };
    std::string& line = lines[i];
    line = "| " + scenario.name + " | " + ablation.component + " |";
    for (const Variant& variant : variants()) line += " " + run(variant.settings) + " |";
    Settings without = ablation.base;
    without.insert(without.end(), ablation.disable.begin(), ablation.disable.end());
    line += ablation.disable.empty() ? " | |" : " " + run(without) + " | " + code(without) + " |";
    line += "\n";
    progress.pause([&] { std::fputs(line.c_str(), stdout); });
  });
  for (const std::string& line : lines) text += line;
  gsv::writeFile(std::filesystem::path(arguments.out) / "ablation.md", text);
}

void check(Arguments* arguments) {
  for (const std::string& setting : arguments->settings) {
    gsv::OfflineRun::Options options;
    gsv::setOption(options, setting);  // rejects it before the runs
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
       "gets scenarios.md and scenarios.json, or ablation.md")  //
      ("ablation", gsv::po::bool_switch(&arguments.ablation),
       "each scenario also with parts of the method switched off")  //
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
