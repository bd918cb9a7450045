#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "ground_scale_vo/io/text_file.hpp"

namespace ground_scale_vo {

/// Line i of timestamps.txt, "2011-09-26 13:02:25.964389445" in UTC, as nanoseconds since the
/// epoch. Throws DataError.
std::int64_t readUtc(const TextFile& text, std::size_t i);

/// Ground truth T_c0_ci [m] of a KITTI raw synced drive from its GPS/IMU readings; empty unless
/// these and the calibration from the GPS/IMU to the camera exist. Throws DataError.
std::vector<Eigen::Isometry3d> readRawGroundTruth(const std::filesystem::path& folder);

}  // namespace ground_scale_vo
