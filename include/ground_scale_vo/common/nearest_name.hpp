#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace ground_scale_vo {

/// Least number of single letters to insert, remove or replace to turn one name into the other.
std::size_t editDistance(const std::string& a, const std::string& b);

/// The candidate with the least edit distance (the first of equals); empty when there is none that
/// shares at least half of the longer name's letters.
std::string nearestName(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace ground_scale_vo
