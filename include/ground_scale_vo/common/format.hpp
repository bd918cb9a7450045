#pragma once

#include <cstdio>
#include <string>

namespace ground_scale_vo {

/// As printf, cut off after 255 characters.
template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// Of an image: "640x480".
inline std::string sizeText(double width, double height) {
  return format("%.0fx%.0f", width, height);
}

}  // namespace ground_scale_vo
