#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <vector>

namespace ground_scale_vo {

/// Ground truth T_c0_ci [m] of a KITTI raw synced drive from its GPS/IMU readings; empty unless
/// these and the calibration from the GPS/IMU to the camera exist. Throws DataError.
std::vector<Eigen::Isometry3d> readRawGroundTruth(const std::filesystem::path& folder);

}  // namespace ground_scale_vo
