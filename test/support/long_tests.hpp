#pragma once

#include <cstdlib>

namespace ground_scale_vo {

/// True while `scripts/test --long` runs the long tests: the drives that do not run by default, or
/// the same tests for longer.
inline bool runsLongTests() { return std::getenv("GROUND_SCALE_VO_LONG") != nullptr; }

}  // namespace ground_scale_vo
