#pragma once

#include <optional>
#include <string>

namespace ground_scale_vo {

/// The text as a number, independent of the locale. Empty when the whole text is not one finite
/// number.
template <typename Number>
std::optional<Number> parseNumber(const std::string& text);  // double, long double

/// The same for the value of an option. Throws an OptionError that names the option.
double parseNumber(const std::string& option, const std::string& text);

/// The same for an integer in [min, max].
int parseInteger(const std::string& option, const std::string& text, int min, int max);

}  // namespace ground_scale_vo
