#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace ground_scale_vo {

// For the error after a mistyped parameter or --set: "...; did you mean camera_height?"

/// Levenshtein distance: least number of characters to insert, remove or replace.
std::size_t editDistance(const std::string& a, const std::string& b);

/// The candidate with the least edit distance, the first of equals. Empty when every distance is
/// more than half of the longer name's length.
std::string nearestName(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace ground_scale_vo
