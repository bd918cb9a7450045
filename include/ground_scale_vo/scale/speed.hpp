#pragma once

#include <cstdint>

namespace gsv {

/// Speed of the vehicle at one instant, of a wheel odometry, CAN bus or GPS.
struct SpeedSample {
  std::int64_t stamp_ns = 0;  ///< of the clock of the images [ns]
  double speed = 0;           ///< [m/s], negative: backwards
  double sigma = 0;           ///< standard deviation [m/s]; 0: not known
};

}  // namespace gsv
