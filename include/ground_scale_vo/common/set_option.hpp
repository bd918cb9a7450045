#pragma once

#include <string>
#include <type_traits>
#include <vector>

#include "ground_scale_vo/common/options.hpp"

namespace ground_scale_vo {

/// A visitor of visitAllParameters() that sets one option from text.
class OptionSetter {
 public:
  /// assignment: "group/name=value". Throws OptionError when it has no '='.
  explicit OptionSetter(const std::string& assignment);

  template <typename Number>
  void operator()(const std::string& name, Number& field, double min, double max,
                  const char* /*meaning*/) {
    if (matches(name)) field = static_cast<Number>(number(min, max, std::is_integral_v<Number>));
  }
  void operator()(const std::string& name, bool& field, const char* /*meaning*/) {
    if (matches(name)) field = boolean();
  }

  /// Throws OptionError, with the nearest known name, when no visited option had the name.
  void requireFound() const;

 private:
  bool matches(const std::string& name);
  double number(double min, double max, bool whole) const;
  bool boolean() const;

  std::string name_, value_;
  std::vector<std::string> known_;  ///< all visited names
  bool found_ = false;
};

/// Sets one option of any Options struct with visitStages() (common/options.hpp) by its full name:
/// "group/name=value", a bool as true or false. Throws OptionError that names the option when the
/// name is unknown, or the value is not a number (for a bool: not true or false), not whole where
/// an integer is needed, or out of range.
template <typename Options>
void setOption(Options& options, const std::string& assignment) {
  OptionSetter setter(assignment);
  visitAllParameters(options, setter);
  setter.requireFound();
}

}  // namespace ground_scale_vo
