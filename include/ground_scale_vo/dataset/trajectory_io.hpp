#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace ground_scale_vo {

/// KITTI: a line of 12 numbers a pose, the upper 3x4 of T_c0_ci row by row. Rotations are made
/// orthonormal on reading (nearest rotation). Throws DataError naming file and line.
std::vector<Eigen::Isometry3d> readKittiPoses(const std::filesystem::path& file);
/// 17 significant digits. Written to a temporary name beside it and renamed. Throws DataError.
void writeKittiPoses(const std::filesystem::path& file, const std::vector<Eigen::Isometry3d>& poses);

struct StampedPose {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_a_b = Eigen::Isometry3d::Identity();
};
/// TUM: `stamp[s] tx ty tz qx qy qz qw`, stamp with nine decimals, exact to the nanosecond.
void writeTumTrajectory(const std::filesystem::path& file, const std::vector<StampedPose>& poses);
std::vector<StampedPose> readTumTrajectory(const std::filesystem::path& file);

}  // namespace ground_scale_vo
