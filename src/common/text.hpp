#pragma once

#include <cstdio>
#include <optional>
#include <string>
#include <vector>

namespace gsv {

/// As printf, cut off after 255 characters.
template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// Size of an image: "640x480".
inline std::string sizeText(double width, double height) {
  return format("%.0fx%.0f", width, height);
}

/// The text as a number, independent of the locale. Empty when the whole text is not one finite
/// number.
template <typename Number>
std::optional<Number> parseNumber(const std::string& text);  // double, long double

/// The candidate with the least edit distance (Levenshtein) to a mistyped name, the first of
/// equals: for "did you mean ...?". Empty when every distance is more than half of the longer
/// name's length.
std::string nearestName(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace gsv
