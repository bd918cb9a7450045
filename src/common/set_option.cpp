#include "ground_scale_vo/common/set_option.hpp"

#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/nearest_name.hpp"
#include "ground_scale_vo/common/parse_number.hpp"

namespace ground_scale_vo {

OptionSetter::OptionSetter(const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw OptionError("'" + assignment + "' is not an assignment; expected [GROUP/]NAME=VALUE");
  }
  name_ = assignment.substr(0, equals);
  value_ = assignment.substr(equals + 1);
}

bool OptionSetter::matches(const std::string& name) {
  known_.push_back(name);
  found_ |= name == name_;
  return name == name_;
}

double OptionSetter::number(double min, double max, bool whole) const {
  const double number = parseNumber(name_, value_);
  requireInRange(name_.c_str(), number, min, max);
  if (whole && number != std::floor(number)) {
    throw OptionError(name_ + ": '" + value_ + "' is not an integer");
  }
  return number;
}

bool OptionSetter::boolean() const {
  if (value_ != "true" && value_ != "false") {
    throw OptionError(name_ + " is '" + value_ + "', it must be true or false");
  }
  return value_ == "true";
}

void OptionSetter::requireFound() const {
  if (found_) return;
  const std::string nearest = nearestName(name_, known_);
  throw OptionError("there is no option " + name_ +
                    (nearest.empty() ? "" : "; did you mean " + nearest + "?"));
}

}  // namespace ground_scale_vo
