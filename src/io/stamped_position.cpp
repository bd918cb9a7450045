#include "ground_scale_vo/io/stamped_position.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace {

// WGS 84 ellipsoid.
constexpr double kSemiMajorAxis = 6378137.0;  // [m]
constexpr double kEccentricity2 = 6.69437999014e-3;

/// Earth-centred, Earth-fixed coordinates [m] of latitude [deg], longitude [deg], altitude [m].
Eigen::Vector3d earthCentred(const Eigen::Vector3d& fix) {
  const double lat = kRadiansPerDegree * fix.x(), lon = kRadiansPerDegree * fix.y();
  const double n = kSemiMajorAxis / std::sqrt(1 - kEccentricity2 * std::sin(lat) * std::sin(lat));
  return {(n + fix.z()) * std::cos(lat) * std::cos(lon),
          (n + fix.z()) * std::cos(lat) * std::sin(lon),
          (n * (1 - kEccentricity2) + fix.z()) * std::sin(lat)};
}

}  // namespace

std::vector<StampedPosition> readStampedPositions(const std::filesystem::path& file,
                                                  const std::vector<std::int64_t>& stamps_ns) {
  const TextFile text(file);
  std::size_t first = 0;
  while (first + 1 < text.size() && text.isComment(first)) ++first;
  std::vector<StampedPosition> positions;
  if (text.wordCount(first) == 12) {
    const std::vector<Eigen::Isometry3d> poses = readKittiPoses(file);
    if (poses.size() != stamps_ns.size()) {
      throw DataError(file.string() + ": has " + std::to_string(poses.size()) +
                      " poses without stamps for " + std::to_string(stamps_ns.size()) + " images");
    }
    for (std::size_t i = 0; i < poses.size(); ++i) {
      positions.push_back({stamps_ns[i], poses[i].translation()});
    }
  } else {
    for (const StampedPose& pose : readTumTrajectory(file)) {
      if (!positions.empty() && pose.stamp_ns <= positions.back().stamp_ns) {
        throw DataError(file.string() + ": its stamps do not increase at " +
                        formatSeconds(pose.stamp_ns));
      }
      positions.push_back({pose.stamp_ns, pose.T_a_b.translation()});
    }
  }
  return positions;
}

std::vector<Eigen::Vector3d> eastNorthUp(const std::vector<Eigen::Vector3d>& fixes) {
  std::vector<Eigen::Vector3d> positions;
  if (fixes.empty()) return positions;
  const double lat = kRadiansPerDegree * fixes.front().x(),
               lon = kRadiansPerDegree * fixes.front().y();
  Eigen::Matrix3d axes;
  axes << -std::sin(lon), std::cos(lon), 0,  //
      -std::sin(lat) * std::cos(lon), -std::sin(lat) * std::sin(lon), std::cos(lat),
      std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat);
  const Eigen::Vector3d origin = earthCentred(fixes.front());
  for (const Eigen::Vector3d& fix : fixes) {
    positions.push_back(axes * (earthCentred(fix) - origin));
  }
  return positions;
}

}  // namespace ground_scale_vo
