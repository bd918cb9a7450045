#pragma once

#include <string>
#include <type_traits>

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

}  // namespace ground_scale_vo
