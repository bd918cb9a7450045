#pragma once

#include <Eigen/Geometry>

#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "simulation/speed_profile.hpp"
#include "simulation/world/road_geometry.hpp"

namespace ground_scale_vo::simulation {

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
