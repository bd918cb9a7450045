#pragma once

#include <cstdlib>

namespace ground_scale_vo {

/// True with `scripts/test --long`: tests run all drives, or for longer.
inline bool runsLongTests() { return std::getenv("GROUND_SCALE_VO_LONG") != nullptr; }

}  // namespace ground_scale_vo
