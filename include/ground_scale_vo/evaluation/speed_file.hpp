#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "ground_scale_vo/scale/speed.hpp"

namespace gsv {

/// Speeds of the vehicle, in order of their stamps, which are of the clock of the images. path: CSV
/// whose heading names the columns stamp [as in times.txt: readImageStamps()], speed or speed_mps,
/// speed_kmh, ... and, optionally, sigma [unit of the speed]; or the folder oxts/ of a KITTI raw
/// drive (forward velocity vf). unit: SpeedUnit::name; empty: that of the column; a column speed is
/// in m/s then, which is refused without a given camera height, because nothing could detect
/// another unit. Throws DataError, and OptionError: no such unit.
std::vector<SpeedSample> readSpeeds(const std::filesystem::path& path, const std::string& unit,
                                    bool height_is_given);

/// The messages of a topic: stamp [ns], velocity, and variance of its x, for VelocityReader.
using Velocities = std::vector<std::tuple<std::int64_t, std::array<double, 3>, double>>;
/// Their speeds with increasing stamps, and a sentence about those that cannot be used, or "".
/// unit: SpeedUnit::name. topic: for sentences. Throws DataError when none can be used, and
/// OptionError: no such unit.
std::pair<std::vector<SpeedSample>, std::string> readVelocities(const Velocities& velocities,
                                                                const std::string& unit,
                                                                const std::string& topic);

/// Throws DataError when more than half of the speeds are faster than any vehicle. name: of the
/// file or topic.
void requireVehicleSpeeds(const std::vector<SpeedSample>& speeds, const std::string& name);

}  // namespace gsv
