#include "ground_scale_vo/evaluation/set_option.hpp"

#include <cmath>
#include <type_traits>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/nearest_name.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/parse_number.hpp"

namespace ground_scale_vo {
namespace {

/// Sets the described option that has the name.
class Setter {
 public:
  Setter(std::string name, std::string value) : name_(std::move(name)), value_(std::move(value)) {}

  template <typename Number>
  void operator()(const std::string& name, Number& field, double min, double max, const char*) {
    if (!isThis(name)) return;
    const double number = parseNumber(name, value_);
    requireInRange(name.c_str(), number, min, max);
    if (std::is_integral_v<Number> && number != std::floor(number)) {
      throw OptionError(name + " is '" + value_ + "', which is not a whole number");
    }
    field = static_cast<Number>(number);
  }
  void operator()(const std::string& name, bool& field, const char*) {
    if (!isThis(name)) return;
    if (value_ != "true" && value_ != "false") {
      throw OptionError(name + " is '" + value_ + "', it must be true or false");
    }
    field = value_ == "true";
  }

  void requireFound() const {
    if (found_) return;
    const std::string nearest = nearestName(name_, known_);
    throw OptionError("there is no option " + name_ +
                      (nearest.empty() ? "" : "; did you mean " + nearest + "?"));
  }

 private:
  bool isThis(const std::string& name) {
    known_.push_back(name);
    found_ |= name == name_;
    return name == name_;
  }

  const std::string name_, value_;
  std::vector<std::string> known_;
  bool found_ = false;
};

}  // namespace

void setOption(MetricOdometry::Options& options, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw OptionError("'" + assignment + "' sets no option, that would be GROUP/NAME=VALUE");
  }
  Setter setter(assignment.substr(0, equals), assignment.substr(equals + 1));
  visitAllParameters(options, setter);
  setter.requireFound();
}

}  // namespace ground_scale_vo
