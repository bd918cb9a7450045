#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "simulation/synthetic_drive.hpp"
#include "simulation/world/recorded_path.hpp"
#include "simulation/world/road_geometry.hpp"

namespace gsv::simulation {

/// The position of the car over time: that of the recorded path, or of the speeds, or of cruise and
/// stop. Between two speeds it changes along a cosine.
class SpeedProfile {
 public:
  /// path: nullptr for a generated road.
  SpeedProfile(const SyntheticDrive::Options& options, std::shared_ptr<const RecordedPath> path);

  /// t [s] may lie before or after the drive.
  LongitudinalState at(double t) const;

  /// Time to brake from the cruising speed to standstill, and to start again [s].
  static double brakingTime(const SyntheticDrive::Options& options);

 private:
  const std::vector<SyntheticDrive::SpeedAt> speeds_;
  const std::shared_ptr<const RecordedPath> path_;
};

/// The ego vehicle at one instant [m].
struct VehiclePose {
  Eigen::Isometry3d T_w_c;     ///< world from camera
  Eigen::Isometry3d T_w_body;  ///< world from body: as the camera, without its mounting angles
  Eigen::Vector3d n_w;         ///< normal of the road plane
  double height;               ///< of the camera over the road plane
};

/// The pose on the lane, with pitch, roll and bounce of the suspension.
VehiclePose vehiclePose(const RoadGeometry& road, const LongitudinalState& state,
                        const SyntheticDrive::Options& options);

}  // namespace gsv::simulation
