#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/scale/speed.hpp"
#include "simulation/synthetic_drive.hpp"

namespace gsv {

/// From the middle of the drive on: 30 % high for 2 s; the same value; zero; a gap of 2 s. In the
/// whole drive: the other sign; stamps 0.2 s late; km/h.
enum class SpeedFault : std::uint8_t { kNone, kSlip, kStuck, kZero, kGap, kSign, kLate, kUnit };

/// All faults with their names.
inline const std::vector<std::pair<std::string, SpeedFault>> kSpeedFaults = {
    {"slip", SpeedFault::kSlip}, {"stuck", SpeedFault::kStuck}, {"zero", SpeedFault::kZero},
    {"gap", SpeedFault::kGap},   {"sign", SpeedFault::kSign},   {"late", SpeedFault::kLate},
    {"unit", SpeedFault::kUnit}};

/// A sensor of the vehicle's speed: 10 Hz, with a noise of 0.5 % of the speed.
std::vector<SpeedSample> simulateSpeeds(const SyntheticDrive& drive,
                                        SpeedFault fault = SpeedFault::kNone);

}  // namespace gsv
