// docs/reference/parameters.md lists what the code declares. With GROUND_SCALE_VO_WRITE_TABLES set
// in the environment, the test first rewrites its rows.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/metric_odometry.hpp"
#include "ros/params.hpp"

namespace ground_scale_vo {
namespace {

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
    // The test below gives only the required parameters.
    const std::string value = entry.given ? "**required**" : "`" + entry.value + "`";
    rows.push_back("| `" + entry.name + "` | " + entry.meaning.substr(1, end - 1) + " | " + value +
                   " | " + entry.range + " | " + meaning + " |");
  }
  return rows;
}

template <typename Params>
std::vector<std::string> parameterRows(const XmlRpc::XmlRpcValue& tree) {
  ParamReader reader("/n", tree);
  Params::read(reader);
  return rows(reader);
}

/// Rows of all options of MetricOdometry.
std::vector<std::string> optionRows() {
  MetricOdometry::Options options;
  ParamReader reader("/n", XmlRpc::XmlRpcValue());
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
  XmlRpc::XmlRpcValue tree;
  tree["camera_height"] = 1.5;  // required
  const auto mono_vo = parameterRows<MonoVoParams>(XmlRpc::XmlRpcValue());
  const auto scale_recovery = parameterRows<ScaleRecoveryParams>(tree);
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
}  // namespace ground_scale_vo
