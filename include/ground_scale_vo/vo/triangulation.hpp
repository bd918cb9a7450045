#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace ground_scale_vo {

/// A point on the ray of its anchor camera: p_anchor = ray / inverse_depth, ray.z() = 1.
struct InverseDepth {
  double value = 0;  ///< 1 / z in the anchor camera
  double sigma = 0;  ///< standard deviation of value
};

struct RayObservation {
  Eigen::Isometry3d T_c_anchor = Eigen::Isometry3d::Identity();
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
};

/// Least squares over all observations (anchor's own excluded), Gauss-Newton on the reprojection
/// error. Empty when there is no observation, the point falls
/// behind a camera, or the iteration does not settle.
std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations);

}  // namespace ground_scale_vo
