// What the nodelets refuse and warn of. docs/reference/parameters.md lists what the code declares:
// with GROUND_SCALE_VO_WRITE_TABLES set in the environment, the test first rewrites its rows.

#include "ros/params.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/metric_odometry.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using XmlRpc::XmlRpcValue;

TEST(ParamReader, ExpandsTheHomeFolderOfFiles) {
  XmlRpcValue tree;
  tree["mask"] = "~/mask.png";
  tree["camera_file"] = "/a/~/camera.yaml";
  ParamReader reader("/n", tree);
  const MonoVoParams params = MonoVoParams::read(reader);
  EXPECT_EQ(params.mask, std::string(std::getenv("HOME")) + "/mask.png");
  EXPECT_EQ(params.camera_file, "/a/~/camera.yaml");
}

XmlRpcValue validTree() {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  return tree;
}

template <typename Value>
void expectRefused(const char* name, const Value& value, const std::string& reason) {
  XmlRpcValue tree = validTree();
  tree[name] = value;
  ParamReader reader("/car/scale_recovery", tree);
  expectThrows<OptionError>([&] { ScaleRecoveryParams::read(reader); }, reason);
}

TEST(MonoVoParams, KnowWhetherTheReadoutTimeIsGiven) {
  XmlRpcValue tree;
  for (const bool given : {false, true}) {
    ParamReader reader("/mono_vo", tree);
    EXPECT_EQ(MonoVoParams::read(reader).readout_time_is_given, given);
    tree["odometry"]["readout_time"] = 0.0;
  }
}

TEST(ParamReader, RefusalsNameTheParameterAndItsRange) {
  expectRefused("camera_height", -1.0,
                "parameter /car/scale_recovery/camera_height is -1, it must lie in [0.05, 100]");
  expectRefused("camera_height", std::nan(""), "nan");
  expectRefused("camera_height", 30.0, "camera_height is 30 m, on a road vehicle it is 0.2 to 5 m");
  expectRefused("camera_height", "high", "camera_height: 'high' is not a number");
  expectRefused("random_seed", 1.5, "random_seed: '1.5' is not an integer");
  expectRefused("publish_tf", 1, "publish_tf is '1', it must be true or false");
  expectRefused("base_frame", "/odom", "must differ");
  expectRefused("odom_frame", "/", "odom_frame is empty");
  ParamReader nothing("/scale_recovery", XmlRpcValue());
  expectThrows<OptionError>([&] { ScaleRecoveryParams::read(nothing); },
                            "neither camera_height [m] is set nor use_speed true");
}

TEST(ParamReader, WarnsOfSlashesInFrameNamesAndOfUnknownNames) {
  XmlRpcValue tree = validTree();
  tree["odom_frame"] = "/map";
  tree["base_fram"] = "b";
  tree["tracker"]["nonsense_nobody_wrote"] = 1;
  ParamReader reader("/scale_recovery", tree);
  EXPECT_EQ(ScaleRecoveryParams::read(reader).odom_frame, "map");
  EXPECT_NE(reader.echo().find("\n  odom_frame = \"map\" "), std::string::npos);
  std::string warnings;
  for (const std::string& warning : reader.warnings()) warnings += warning + '\n';
  for (const char* part :
       {"/scale_recovery/odom_frame is \"/map\"",
        "parameter /scale_recovery/base_fram is unknown and has no effect; did you mean "
        "/scale_recovery/base_frame?\n",
        "parameter /scale_recovery/tracker/nonsense_nobody_wrote is unknown and has no effect\n"}) {
    EXPECT_NE(warnings.find(part), std::string::npos) << warnings;
  }
  EXPECT_EQ(reader.warnings().size(), 3u) << warnings;
}

const std::filesystem::path kPage =
    std::filesystem::path(__FILE__).parent_path() / "../../docs/reference/parameters.md";

/// A row for each parameter: name, unit, default, range, meaning.
std::vector<std::string> rows(const ParamReader& reader) {
  std::vector<std::string> rows;
  for (const ParamReader::Entry& entry : reader.entries()) {
    const std::size_t end = entry.meaning.find("] ");
    // A bar would end the cell.
    const std::string meaning =
        std::regex_replace(entry.meaning.substr(end + 2), std::regex("\\|"), "\\|");
    // validTree() gives only the required parameters.
    const std::string value = entry.given ? "**required**" : "`" + entry.value + "`";
    rows.push_back("| `" + entry.name + "` | " + entry.meaning.substr(1, end - 1) + " | " + value +
                   " | " + entry.range + " | " + meaning + " |");
  }
  return rows;
}

template <typename Params>
std::vector<std::string> parameterRows(const XmlRpcValue& tree) {
  ParamReader reader("/n", tree);
  Params::read(reader);
  return rows(reader);
}

/// Rows of all options of MetricOdometry.
std::vector<std::string> optionRows() {
  MetricOdometry::Options options;
  ParamReader reader("/n", XmlRpcValue());
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... rest) {
    reader.declare(name, field, rest...);
  });
  return rows(reader);
}

/// The page's rows below a heading. If replacement is not null, writes it into the page in their
/// place.
std::vector<std::string> pageRows(const std::string& heading,
                                  const std::vector<std::string>* replacement = nullptr) {
  std::ifstream stream(kPage);
  std::vector<std::string> rows;
  std::ostringstream page;
  bool inside = false;
  for (std::string line; std::getline(stream, line);) {
    if (line.rfind("##", 0) == 0) inside = line == heading;
    if (inside && line.rfind("| `", 0) == 0) {
      rows.push_back(line);
      if (replacement) continue;
    }
    page << line << '\n';
    if (inside && replacement && line.rfind("|---", 0) == 0) {
      for (const std::string& row : *replacement) page << row << '\n';
    }
  }
  stream.close();
  if (replacement) std::ofstream(kPage) << page.str();
  return rows;
}

void expectOnPage(const std::string& heading, const std::vector<std::string>& code) {
  if (std::getenv("GROUND_SCALE_VO_WRITE_TABLES") != nullptr) pageRows(heading, &code);
  EXPECT_EQ(pageRows(heading), code)
      << kPage << " differs from the code below \"" << heading
      << "\"; GROUND_SCALE_VO_WRITE_TABLES=1 and this test rewrite it";
}

TEST(ParameterTable, ListsAllParametersAndOptions) {
  const auto mono_vo = parameterRows<MonoVoParams>(XmlRpcValue());
  const auto scale_recovery = parameterRows<ScaleRecoveryParams>(validTree());
  expectOnPage("### MonoVo", mono_vo);
  expectOnPage("### ScaleRecovery", scale_recovery);
  std::vector<std::string> others = optionRows();
  others.erase(std::remove_if(others.begin(), others.end(),
                              [&](const std::string& row) {
                                return std::count(mono_vo.begin(), mono_vo.end(), row) +
                                           std::count(scale_recovery.begin(), scale_recovery.end(),
                                                      row) >
                                       0;
                              }),
               others.end());
  expectOnPage("## Offline options", others);
}

}  // namespace
}  // namespace gsv
