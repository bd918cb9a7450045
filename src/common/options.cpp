#include "ground_scale_vo/common/options.hpp"

#include <yaml-cpp/yaml.h>

#include <cmath>

#include "common/text.hpp"

namespace gsv {
namespace {

void collectAssignments(const YAML::Node& node, const std::string& name,
                        std::vector<std::string>* assignments) {
  if (node.IsMap()) {
    for (const auto& entry : node) {
      const auto key = entry.first.as<std::string>();
      collectAssignments(entry.second, name.empty() ? key : name + "/" + key, assignments);
    }
  } else if (node.IsScalar() && !name.empty()) {
    assignments->push_back(name + "=" + node.Scalar());
  } else {
    throw DataError(name.empty() ? "it is no map of options" : name + " is not one value");
  }
}

}  // namespace

std::vector<std::string> readOptions(const std::string& file) {
  std::vector<std::string> assignments;
  try {
    collectAssignments(YAML::LoadFile(file), "", &assignments);
  } catch (const std::exception& error) {
    throw DataError("options file " + file + ": " + error.what());
  }
  return assignments;
}

double optionNumber(const std::string& name, const std::string& text, double min, double max,
                    bool is_whole) {
  const auto number = parseNumber<double>(text);
  if (!number) throw OptionError(name + ": '" + text + "' is not a number");
  requireInRange(name.c_str(), *number, min, max);
  if (is_whole && *number != std::floor(*number)) {
    throw OptionError(name + ": '" + text + "' is not an integer");
  }
  return *number;
}

void setOptionValue(const std::string& name, const std::string& text, bool* field,
                    const char* /*meaning*/) {
  if (text != "true" && text != "false") {
    throw OptionError(name + " is '" + text + "', it must be true or false");
  }
  *field = text == "true";
}

void failAsUnknownOption(const std::string& name, const std::vector<std::string>& known) {
  const std::string nearest = nearestName(name, known);
  throw OptionError("there is no option " + name +
                    (nearest.empty() ? "" : "; did you mean " + nearest + "?"));
}

}  // namespace gsv
