#pragma once

#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {

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

/// A visitor that throws OptionError for the first number outside its range.
class RangeCheck {
 public:
  explicit RangeCheck(std::string group) : group_(std::move(group)) {}

  template <typename Number>
  void operator()(const char* name, const Number& value, double min, double max,
                  const char* /*meaning*/) const {
    static_assert(std::is_arithmetic_v<Number> && !std::is_same_v<Number, bool>);
    requireInRange((group_ + name).c_str(), static_cast<double>(value), min, max);
  }
  void operator()(const char* /*name*/, bool /*value*/, const char* /*meaning*/) const {}

 private:
  std::string group_;  ///< "tracker/", or empty
};

/// Throws OptionError for the first number outside its range. Called once, where options enter a
/// class that users construct: the stages of that class get options that are valid.
template <typename Options>
void requireInRanges(const Options& options) {
  Options::visitStages(options, [](const std::string& group, const auto& stage) {
    stage.visitParameters(stage, RangeCheck(group));
  });
}

/// An assignment "group/name=value" of an option, with the conversions of its value. All throw
/// OptionError.
class Assignment {
 public:
  explicit Assignment(const std::string& text);
  const std::string& name() const { return name_; }

  template <typename Number>
  void set(Number* field, double min, double max, const char* /*meaning*/) const {
    *field = static_cast<Number>(number(min, max, std::is_integral_v<Number>));
  }
  void set(bool* field, const char* /*meaning*/) const;
  /// Names the nearest of the known names.
  [[noreturn]] void failAsUnknown(const std::vector<std::string>& known) const;

 private:
  double number(double min, double max, bool whole) const;

  std::string name_, value_;
};

/// Sets one option of any Options struct with visitStages() by its full name: "group/name=value", a
/// bool as true or false. Throws OptionError that names the option when the name is unknown, or the
/// value is not a number (for a bool: not true or false), not whole where an integer is needed, or
/// out of range.
template <typename Options>
void setOption(Options& options, const std::string& assignment) {
  const Assignment wanted(assignment);
  std::vector<std::string> known;
  bool is_found = false;
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... range) {
    known.push_back(name);
    if (name != wanted.name()) return;
    wanted.set(&field, range...);
    is_found = true;
  });
  if (!is_found) wanted.failAsUnknown(known);
}

}  // namespace ground_scale_vo
