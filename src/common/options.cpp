#include "ground_scale_vo/common/options.hpp"

#include <cmath>

#include "common/text.hpp"

namespace ground_scale_vo {

Assignment::Assignment(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) {
    throw OptionError("'" + text + "' is not an assignment; expected [GROUP/]NAME=VALUE");
  }
  name_ = text.substr(0, equals);
  value_ = text.substr(equals + 1);
}

double Assignment::number(double min, double max, bool whole) const {
  const auto number = parseNumber<double>(value_);
  if (!number) throw OptionError(name_ + ": '" + value_ + "' is not a number");
  requireInRange(name_.c_str(), *number, min, max);
  if (whole && *number != std::floor(*number)) {
    throw OptionError(name_ + ": '" + value_ + "' is not an integer");
  }
  return *number;
}

void Assignment::set(bool* field, const char* /*meaning*/) const {
  if (value_ != "true" && value_ != "false") {
    throw OptionError(name_ + " is '" + value_ + "', it must be true or false");
  }
  *field = value_ == "true";
}

void Assignment::failAsUnknown(const std::vector<std::string>& known) const {
  const std::string nearest = nearestName(name_, known);
  throw OptionError("there is no option " + name_ +
                    (nearest.empty() ? "" : "; did you mean " + nearest + "?"));
}

}  // namespace ground_scale_vo
