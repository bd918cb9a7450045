#pragma once

#include <cstdlib>

namespace gsv {

/// True while `scripts/test --long` runs the long tests: the drives that do not run by default, or
/// the same tests for longer.
inline bool runsLongTests() { return std::getenv("GROUND_SCALE_VO_LONG") != nullptr; }

}  // namespace gsv
