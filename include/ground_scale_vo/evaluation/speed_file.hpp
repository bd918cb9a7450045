#pragma once

#include <filesystem>
#include <vector>

#include "ground_scale_vo/scale/speed.hpp"

namespace gsv {

/// Speeds of the vehicle, in order of their stamps, which are of the clock of the images. path: CSV
/// whose heading names the columns stamp [s], speed [m/s] and, optionally, sigma [m/s]; or the
/// folder oxts/ of a KITTI raw drive (forward velocity vf). Throws DataError.
std::vector<SpeedSample> readSpeeds(const std::filesystem::path& path);

}  // namespace gsv
