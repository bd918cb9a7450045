#include "ground_scale_vo/common/parse_number.hpp"

#include <cmath>
#include <ios>
#include <locale>
#include <sstream>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {

template <typename Number>
std::optional<Number> parseNumber(const std::string& text) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  Number value{};
  if (!(stream >> std::noskipws >> value) ||
      stream.peek() != std::istringstream::traits_type::eof() || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}
template std::optional<double> parseNumber(const std::string& text);
template std::optional<long double> parseNumber(const std::string& text);

double parseNumber(const std::string& option, const std::string& text) {
  const auto value = parseNumber<double>(text);
  if (!value) throw OptionError(option + ": '" + text + "' is not a number");
  return *value;
}

int parseInteger(const std::string& option, const std::string& text, int min, int max) {
  const double value = parseNumber(option, text);
  requireInRange(option.c_str(), value, min, max);
  if (value != std::floor(value)) {
    throw OptionError(option + ": '" + text + "' is not an integer");
  }
  return static_cast<int>(value);
}

}  // namespace ground_scale_vo
