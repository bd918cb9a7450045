#pragma once

#include <optional>
#include <string>

namespace ground_scale_vo {

/// The whole text as one number, the same in every locale; nothing when it is none. NaN and
/// infinity are none.
template <typename Number>
std::optional<Number> parseNumber(const std::string& text);  // double, long double

/// Likewise, the value of an option. Throws OptionError that names it.
double parseNumber(const std::string& option, const std::string& text);

/// Likewise, a whole number in [min, max].
int parseWholeNumber(const std::string& option, const std::string& text, int min, int max);

}  // namespace ground_scale_vo
