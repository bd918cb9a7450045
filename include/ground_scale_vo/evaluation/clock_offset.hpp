#pragma once

#include <optional>
#include <vector>

#include "ground_scale_vo/scale/speed.hpp"

namespace gsv {

/// Offset between the clocks of two sensors that measure the same motion.
struct ClockOffset {
  double offset_s = 0;     ///< add it to the stamps of the second one [s]
  double sigma_s = 0;      ///< its standard deviation [s]
  double correlation = 0;  ///< of the speeds with this offset, 0.7 to 1
};

/// Correlates the speeds of two sensors, each in any unit, in order of their stamps, signed both or
/// unsigned both. All offsets are compared at which half of the shorter series overlaps the other
/// one, so the clocks may have different origins. nullopt: the motion does not determine the
/// offset (constant speed, too short, repeated patterns), or the speeds are of different motions.
std::optional<ClockOffset> clockOffset(const std::vector<SpeedSample>& reference,
                                       const std::vector<SpeedSample>& other);

}  // namespace gsv
