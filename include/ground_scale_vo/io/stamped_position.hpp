#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace ground_scale_vo {

/// A measured or known position of a point that is fixed to the vehicle.
struct StampedPosition {
  std::int64_t stamp_ns = 0;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  ///< [m], in any fixed frame
};

/// The positions of a trajectory file: KITTI (12 numbers a line, a line for each of the stamps) or
/// TUM (8 numbers a line, by ascending stamp). Throws DataError.
std::vector<StampedPosition> readStampedPositions(const std::filesystem::path& file,
                                                  const std::vector<std::int64_t>& stamps_ns);

/// WGS 84 coordinates (latitude [deg], longitude [deg], altitude [m]) in the local east, north, up
/// frame of the first one [m].
std::vector<Eigen::Vector3d> eastNorthUp(const std::vector<Eigen::Vector3d>& fixes);

}  // namespace ground_scale_vo
