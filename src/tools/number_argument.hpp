#pragma once

#include <cstdlib>
#include <string>

#include "ground_scale_vo/error.hpp"

namespace ground_scale_vo {

/// The value of a command's option. Throws OptionError that names it when it is no number.
inline double parseNumber(const std::string& option, const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') {
    throw OptionError(option + " is '" + text + "', which is not a number");
  }
  return value;
}

}  // namespace ground_scale_vo
