// docs/reference/parameters.md and the code say the same.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo {
namespace {

const std::filesystem::path kTable =
    std::filesystem::path(__FILE__).parent_path() / "../../docs/reference/parameters.md";

/// A bar would end the cell.
std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) result += c == '|' ? std::string("\\|") : std::string(1, c);
  return result;
}

/// The row of an entry: name, unit, default, range, meaning.
std::string row(const ParamReader::Entry& entry) {
  const std::size_t end = entry.meaning.find("] ");
  const std::string unit = entry.meaning.substr(1, end - 1);
  const std::string meaning = entry.meaning.substr(end + 2);
  const std::string value = entry.given ? "**required**" : "`" + entry.value + "`";
  return "| `" + entry.name + "` | " + unit + " | " + value + " | " + entry.range + " | " +
         escaped(meaning) + " |";
}

template <typename Params>
std::vector<std::string> rowsOf(XmlRpc::XmlRpcValue tree) {
  ParamReader reader("/n", tree);
  Params::read(reader);
  std::vector<std::string> rows;
  for (const ParamReader::Entry& entry : reader.entries()) rows.push_back(row(entry));
  return rows;
}

/// The rows of the table below a heading.
std::vector<std::string> rowsBelow(const std::string& heading) {
  std::ifstream stream(kTable);
  std::vector<std::string> rows;
  bool inside = false;
  for (std::string line; std::getline(stream, line);) {
    if (line.rfind("## ", 0) == 0) inside = line == heading;
    if (inside && line.rfind("| `", 0) == 0) rows.push_back(line);
  }
  return rows;
}

void expectSame(const std::vector<std::string>& written, const std::vector<std::string>& code) {
  const std::set<std::string> in_table(written.begin(), written.end());
  const std::set<std::string> in_code(code.begin(), code.end());
  for (const std::string& line : code) {
    EXPECT_EQ(in_table.count(line), 1u) << "docs/reference/parameters.md lacks the row\n" << line;
  }
  for (const std::string& line : written) {
    EXPECT_EQ(in_code.count(line), 1u) << "docs/reference/parameters.md has a row of its own\n"
                                       << line;
  }
  EXPECT_EQ(written.size(), in_table.size()) << "a row stands twice";
}

TEST(ParameterTable, MonoVo) {
  expectSame(rowsBelow("## MonoVo"), rowsOf<MonoVoParams>(XmlRpc::XmlRpcValue()));
}

TEST(ParameterTable, ScaleRecovery) {
  XmlRpc::XmlRpcValue tree;
  tree["camera_height"] = 1.5;  // the one that is required
  expectSame(rowsBelow("## ScaleRecovery"), rowsOf<ScaleRecoveryParams>(tree));
}

}  // namespace
}  // namespace ground_scale_vo
