#pragma once

#include <Eigen/Core>

namespace ground_scale_vo {

/// The road as a plane in some camera's axes: n_c . x_c + height = 0, with n_c unit and pointing up
/// out of the road (its y component is negative). height > 0 is the camera's distance from the
/// plane in VO units. This is Eq. 2 with the opposite sign of the normal.
struct GroundPlane {
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
  double height = 0;
};

/// Prior on the road's normal in one frame, from the mounting and the motion.
struct NormalPrior {
  Eigen::Vector3d n_c = Eigen::Vector3d(0, -1, 0);       ///< unit, up
  Eigen::Vector3d forward_c = Eigen::Vector3d(0, 0, 1);  ///< unit, orthogonal to n_c
  double pitch_sigma = 0;  ///< standard deviation about lateral() [rad]
  double roll_sigma = 0;   ///< standard deviation about forward_c [rad]

  Eigen::Vector3d lateral() const { return n_c.cross(forward_c); }  ///< unit, to the left
};

}  // namespace ground_scale_vo
