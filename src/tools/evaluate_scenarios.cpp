// Renders the drives of the scenario catalogue, runs the pipeline over each and tables the figures.

#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "for_all.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/set_option.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/simulation/scenarios.hpp"
#include "progress_line.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kUsage =
    R"(usage: evaluate_scenarios [--remedies] [NAME...] --out DIR [options]

Renders drives that are hard for a camera, each with exact truth, runs the odometry over them and
tables how well it measured.

  NAME          of a drive (render_drive --list); default: all
  --out DIR     DIR/scenarios.md and DIR/scenarios.json are written
  --threads N   drives at once (default 1)
  --set GROUP/NAME=VALUE
                an option other than its default, by the name of its parameter
                (docs/parameters.md); as often as needed

Figures are of the way from the first metric pose on. RLE: error of its length; t_err short: the
devkit's error over 10, 20 ... 80 m; scale: median error of the scale against that of 2 m of true
way; held: share of frames without a measurement of their own; 2 sigma: share of frames whose true
scale lies within two reported sigma; ok hidden: share of measured frames where the road shows
nothing that could be measured, which should be 0.

--remedies runs over each drive again and again instead: with all, with the paper's choices as
printed, with the road's points and with its pixels alone, and without the thing that makes this
drive right. A cell of its table is RLE % / held / 2 sigma, bold where the drive is not measured,
with the reason: lost on the way, no start in its first half, RLE above 1.5 %, 2 sigma below 0.75,
ok hidden. It goes to DIR/remedies.md.

Exit status: 0 done, 1 DIR cannot be written, 2 the arguments cannot be used.
)";

struct Arguments {
  std::vector<gsv::Scenario> scenarios;
  std::string out;
  int threads = 1;
  bool remedies = false;
  std::vector<std::string> settings;  ///< as of setOption
};

Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto value = [&] {
      if (++i == argc) throw gsv::OptionError(argument + " needs a value");
      return std::string(argv[i]);
    };
    if (argument == "--out") {
      arguments.out = value();
    } else if (argument == "--threads") {
      arguments.threads = gsv::parseWholeNumber(argument, value(), 1, 256);
    } else if (argument == "--set") {
      arguments.settings.push_back(value());
      gsv::OfflineRun::Options options;
      gsv::setOption(options, arguments.settings.back());  // refused now rather than in the runs
    } else if (argument == "--remedies") {
      arguments.remedies = true;
    } else if (argument.size() > 1 && argument.front() == '-') {
      throw gsv::OptionError(argument + " is not an option, see --help");
    } else {
      arguments.scenarios.push_back(gsv::findScenario(argument));
    }
  }
  if (arguments.out.empty()) throw gsv::OptionError("--out is missing, see --help");
  if (arguments.scenarios.empty()) arguments.scenarios = gsv::allScenarios();
  return arguments;
}

struct Row {
  std::string name;
  gsv::DriveFigures figures;
};

/// A column of both files: its heading, its key, and a decimal number or nothing.
struct Column {
  const char *heading, *key;
  int decimals;
  double (*value)(const gsv::DriveFigures&);
};
using Figures = gsv::DriveFigures;
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

std::string markdown(const std::vector<Row>& rows) {
  std::string text = "| drive |", rule = "|---|";
  for (const Column& column : kColumns) {
    text += std::string(" ") + column.heading + " |";
    rule += "---|";
  }
  text += "\n" + rule + "\n";
  for (const Row& row : rows) {
    text += "| " + row.name + " |";
    for (const Column& column : kColumns) text += " " + number(column, row.figures, "–") + " |";
    text += "\n";
  }
  return text;
}

std::string json(const std::vector<Row>& rows) {
  std::string text;
  for (const Row& row : rows) {
    text += (text.empty() ? "" : ",\n") + std::string("  {\"drive\": \"") + row.name + "\"";
    for (const Column& column : kColumns) {
      text += std::string(", \"") + column.key + "\": " + number(column, row.figures, "null");
    }
    text += "}";
  }
  return "[\n" + text + "\n]\n";
}

void printHeading() {
  std::printf("%-18s", "drive");
  for (const Column& column : kColumns) std::printf("  %s", column.heading);
  std::printf("  seconds\n");
}

void print(const Row& row, double seconds) {
  std::printf("%-18s", row.name.c_str());
  for (const Column& column : kColumns) {
    const auto width = static_cast<int>(std::string(column.heading).size()) + 2;
    std::printf("%*s", width, number(column, row.figures, "-").c_str());
  }
  std::printf("%9.1f\n", seconds);
}

std::size_t frames(const gsv::Scenario& scenario) {
  return static_cast<std::size_t>(scenario.options.frames);
}

void tabulate(const Arguments& arguments) {
  printHeading();
  std::vector<Row> rows(arguments.scenarios.size());
  std::size_t images = 0;  // rendered, and again for each run over them
  for (const gsv::Scenario& scenario : arguments.scenarios) images += 2 * frames(scenario);
  gsv::ProgressLine progress("evaluate_scenarios", images);
  const auto step = [&progress] { progress.step("images"); };
  gsv::forAll(rows.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::Stopwatch watch;
    const gsv::SyntheticDrive drive(scenario.options);
    const gsv::RunRecord record =
        gsv::runDrive(drive, gsv::renderDrive(drive, step), arguments.settings, step);
    rows[i] = {scenario.name, gsv::driveFigures(scenario, drive, record)};
    progress.pause([&] { print(rows[i], watch.seconds()); });
  });
  const std::filesystem::path out(arguments.out);
  gsv::writeFile(out / "scenarios.md", markdown(rows));
  gsv::writeFile(out / "scenarios.json", json(rows));
}

/// RLE % / held / 2 sigma; bold, with the reason, when a bar is broken.
std::string cell(const Figures& figures, const gsv::DriveThresholds& bars) {
  const std::string broken = gsv::violatedThreshold(figures, bars);
  if (figures.metric_frames == 0) return broken == "lost" ? "**lost**" : "**no start**";
  char text[64];
  std::snprintf(text, sizeof text, "%.2f / %.2f / %.2f", figures.rle_percent, figures.held,
                figures.within_2_sigma);
  if (broken.empty()) return text;
  if (broken == "ok hidden") {
    std::snprintf(text + std::strlen(text), sizeof text - std::strlen(text), " / %.2f",
                  figures.ok_while_hidden);
  }
  return std::string("**") + text + "** " + broken;
}

using Settings = std::vector<std::string>;

/// A run over every drive.
struct Variant {
  const char* heading;
  Settings settings;
};

std::vector<Variant> variants() {
  return {{"as it is", {}},
          {"the paper as printed", {"paper_literal=true"}},
          {"points alone", {gsv::kFeatureBasedOnly}},
          {"pixels alone", {gsv::kDirectOnly}}};
}

std::string code(const Settings& settings) {
  std::string text;
  for (const std::string& setting : settings) {
    text += (text.empty() ? "`" : ", `") + setting + "`";
  }
  return text;
}

void tabulateRemedies(const Arguments& arguments) {
  std::string text = "| drive | what makes it right |", rule = "|---|---|";
  for (const Variant& variant : variants()) {
    text += std::string(" ") + variant.heading + " |";
    rule += "---|";
  }
  text += " without it | which is |\n" + rule + "---|---|\n";
  std::fputs(text.c_str(), stdout);
  std::vector<std::string> lines(arguments.scenarios.size());
  std::size_t images = 0;  // rendered, and again for each run over them
  for (const gsv::Scenario& scenario : arguments.scenarios) {
    const std::size_t runs = variants().size() + !scenario.remedy.without.empty();
    images += (1 + runs) * frames(scenario);
  }
  gsv::ProgressLine progress("evaluate_scenarios", images);
  const auto step = [&progress] { progress.step("images"); };
  gsv::forAll(lines.size(), arguments.threads, [&](std::size_t i) {
    const gsv::Scenario& scenario = arguments.scenarios[i];
    const gsv::ScenarioAblation& remedy = scenario.remedy;
    const gsv::SyntheticDrive drive(scenario.options);
    const std::vector<cv::Mat> rendered = gsv::renderDrive(drive, step);
    const auto run = [&](const Settings& settings) {
      Settings all = arguments.settings;
      all.insert(all.end(), settings.begin(), settings.end());
      return cell(gsv::driveFigures(scenario, drive, gsv::runDrive(drive, rendered, all, step)),
                  scenario.bars);
    };
    std::string& line = lines[i];
    line = "| " + scenario.name + " | " + remedy.what + " |";
    for (const Variant& variant : variants()) line += " " + run(variant.settings) + " |";
    Settings without = remedy.with;
    without.insert(without.end(), remedy.without.begin(), remedy.without.end());
    line += remedy.without.empty() ? " | |" : " " + run(without) + " | " + code(without) + " |";
    line += "\n";
    progress.pause([&] { std::fputs(line.c_str(), stdout); });
  });
  for (const std::string& line : lines) text += line;
  gsv::writeFile(std::filesystem::path(arguments.out) / "remedies.md", text);
}

void run(const Arguments& arguments) {
  cv::setNumThreads(1);
  gsv::makeFolder(arguments.out);  // fails now rather than after the runs
  if (arguments.remedies) {
    tabulateRemedies(arguments);
  } else {
    tabulate(arguments);
  }
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("evaluate_scenarios", kUsage, argc, argv, parseArguments, run);
}
