#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"

namespace gsv {

/// The rotation nearest to m (least squares). Precondition: det(m) > 0.
Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m);

/// The rigid transform with the rotation nearest to m; empty when an entry of m
/// differs from it by more than rounding explains (0.01).
std::optional<Eigen::Isometry3d> rigidTransform(const Eigen::Matrix3d& m, const Eigen::Vector3d& t);

/// KITTI: a line of 12 numbers per pose, the upper 3x4 of T_c0_ci row by row. Rotations are made
/// orthonormal on reading (nearest rotation). Throws DataError that names file and line.
std::vector<Eigen::Isometry3d> readKittiPoses(const std::filesystem::path& file);
/// 17 significant digits. Written as by writeFile(). Throws DataError.
void writeKittiPoses(const std::filesystem::path& file,
                     const std::vector<Eigen::Isometry3d>& poses);

/// TUM: `stamp[s] tx ty tz qx qy qz qw`, stamp with nine decimals, exact to the nanosecond. Throws
/// DataError.
void writeTumTrajectory(const std::filesystem::path& file, const std::vector<StampedPose>& poses);

/// A stream for a CSV table that begins with the heading: numbers with 10 significant digits, the
/// same in every locale.
std::ostringstream csvStream(const std::string& heading);

}  // namespace gsv
