#pragma once

#include <sstream>
#include <string>

namespace ground_scale_vo {

/// A stream for a CSV table that begins with the heading: numbers with 10 significant digits, the
/// same in every locale.
std::ostringstream csvStream(const std::string& heading);

}  // namespace ground_scale_vo
