#pragma once

#include <Eigen/Core>
#include <cmath>

namespace ground_scale_vo {

/// The road as a plane in some camera's axes: n_c . x_c + height = 0, with n_c unit and pointing up
/// out of the road (its y component is negative). height > 0 is the camera's distance from the
/// plane in VO units. This is Eq. 2 with the opposite sign of the normal.
struct GroundPlane {
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
  double height = 0;
};

/// Prior on the road's normal in one frame, from the mounting and the motion, and where to look for
/// the road.
struct NormalPrior {
  Eigen::Vector3d n_c = Eigen::Vector3d(0, -1, 0);       ///< unit, up
  Eigen::Vector3d forward_c = Eigen::Vector3d(0, 0, 1);  ///< unit, orthogonal to n_c
  double pitch_sigma = 0;  ///< standard deviation about lateral() [rad]
  double roll_sigma = 0;   ///< standard deviation about forward_c [rad]
  /// Lateral position, to the left of the path, of the middle of the region in which the road is
  /// measured [camera heights]. 0: on the path.
  double region_offset = 0;

  Eigen::Vector3d lateral() const { return n_c.cross(forward_c); }  ///< unit, to the left
  /// Largest plausible pitch and roll of a plane against n_c [rad]: the tolerance [rad], and three
  /// standard deviations of the prior added in quadrature.
  double pitchTolerance(double tolerance) const { return std::hypot(tolerance, 3 * pitch_sigma); }
  double rollTolerance(double tolerance) const { return std::hypot(tolerance, 3 * roll_sigma); }
};

}  // namespace ground_scale_vo
