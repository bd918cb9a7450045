#pragma once

#include <Eigen/Core>

namespace ground_scale_vo {

/// The road as a plane in some camera's axes: n_c . x_c + height = 0 with n_c unit and pointing up
/// (out of the road, so y, which points down, is negative). height > 0 is the distance of that
/// camera from the plane, in VO units. This is Eq. 2 with the sign of the normal turned.
struct GroundPlane {
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
  double height = 0;
};

/// What is believed of the road's normal before a frame's points are looked at.
struct NormalPrior {
  Eigen::Vector3d n_c = Eigen::Vector3d(0, -1, 0);       ///< unit, up
  Eigen::Vector3d forward_c = Eigen::Vector3d(0, 0, 1);  ///< unit, orthogonal to n_c
  double pitch_sigma = 0;                                ///< of n_c about the lateral axis [rad]
  double roll_sigma = 0;                                 ///< of n_c about forward_c [rad]

  Eigen::Vector3d lateral() const { return n_c.cross(forward_c); }  ///< unit, towards the left
};

}  // namespace ground_scale_vo
