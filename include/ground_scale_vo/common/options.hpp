#pragma once

#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "ground_scale_vo/common/error.hpp"

namespace gsv {

// Every Options struct lists its fields once:
//
//   template <typename Self, typename Visit>
//   static void visitParameters(Self& self, Visit&& visit) {
//     visit("name", self.field, min, max, "[unit] meaning");   // numbers
//     visit("name", self.flag, "[] meaning");                  // bools
//   }
//
// validate(), the offline tools' --set and the reference of the options are derived from that list.
// The nodelets read a selection of the options as ROS parameters (ros/params.hpp).
//
// An option's full name is group/name; each stage is a group. Options that contain the options of
// stages list them with their groups (an empty group: no prefix):
//
//   template <typename Self, typename Visit>
//   static void visitStages(Self& self, Visit&& visit) {
//     visit("group/", self.stage);
//   }

/// Every option of all stages under its full name: visit(name, field, min, max, meaning) or
/// visit(name, flag, meaning).
template <typename Options, typename Visit>
void visitAllParameters(Options& options, Visit&& visit) {
  Options::visitStages(options, [&visit](const std::string& group, auto& stage) {
    stage.visitParameters(stage, [&](const char* name, auto& field, auto... rest) {
      visit(group + name, field, rest...);
    });
  });
}

/// Throws OptionError for the first number outside its range. Called once, where options enter a
/// class that users construct: the stages of that class get options that are valid.
template <typename Options>
void requireInRanges(const Options& options) {
  visitAllParameters(options, [](const std::string& name, const auto& value, auto... range) {
    if constexpr (sizeof...(range) == 3) {  // of a number: min, max, meaning
      const auto limits = std::tuple(range...);
      requireInRange(name.c_str(), static_cast<double>(value), std::get<0>(limits),
                     std::get<1>(limits));
    }
  });
}

/// The options of a YAML file (group/name: value, or nested maps) as assignments for setOption().
/// Throws DataError that names the file.
std::vector<std::string> readOptions(const std::string& file);

// Of setOption(): the value of an option from its text. All throw OptionError.
double optionNumber(const std::string& name, const std::string& text, double min, double max,
                    bool is_whole);
template <typename Number>
void setOptionValue(const std::string& name, const std::string& text, Number* field, double min,
                    double max, const char* /*meaning*/) {
  *field = static_cast<Number>(optionNumber(name, text, min, max, std::is_integral_v<Number>));
}
void setOptionValue(const std::string& name, const std::string& text, bool* field,
                    const char* meaning);
/// Throws OptionError: there is no option of this name; with the nearest of the known names.
[[noreturn]] void failAsUnknownOption(const std::string& name,
                                      const std::vector<std::string>& known);

/// Sets one option of any Options struct with visitStages() by its full name: "group/name=value", a
/// bool as true or false. Throws OptionError that names the option when the name is unknown, or the
/// value is not a number (for a bool: not true or false), not whole where an integer is needed, or
/// out of range.
template <typename Options>
void setOption(Options& options, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw OptionError("'" + assignment + "' is not an assignment; expected [GROUP/]NAME=VALUE");
  }
  const std::string wanted = assignment.substr(0, equals);
  std::vector<std::string> known;
  bool is_found = false;
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... range) {
    known.push_back(name);
    if (name != wanted) return;
    setOptionValue(name, assignment.substr(equals + 1), &field, range...);
    is_found = true;
  });
  if (!is_found) failAsUnknownOption(wanted, known);
}

}  // namespace gsv
