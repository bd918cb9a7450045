#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "simulation/synthetic_drive.hpp"
#include "simulation/world/recorded_path.hpp"
#include "simulation/world/road_geometry.hpp"

namespace ground_scale_vo::simulation {

/// The position of the car over time: that of the recorded path, or cruise and stop, whose speed
/// changes follow a cosine.
class SpeedProfile {
 public:
  /// path: nullptr for a generated road.
  SpeedProfile(const SyntheticDrive::Options& options, std::shared_ptr<const RecordedPath> path);

  /// t [s] may lie before or after the drive.
  LongitudinalState at(double t) const {
    if (path_) return path_->at(t);
    return speeds_.empty() ? cruise(t) : fromTable(t);
  }

  /// Time to brake from the cruising speed to standstill [s].
  static double brakingTime(const SyntheticDrive::Options& options);

 private:
  LongitudinalState cruise(double t) const;
  LongitudinalState fromTable(double t) const;

  const double cruise_speed_;  // [m/s]
  const double braking_s_;     // to brake, and to start again [s]
  const double stop_s_;        // at standstill [s]; 0: no stop
  const double stop_at_m_;
  const double brake_at_s_;  // when braking begins [s]
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

}  // namespace ground_scale_vo::simulation
