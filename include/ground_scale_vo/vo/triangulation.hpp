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

/// What a camera sees of the point on the anchor's ray.
struct RayProjection {
  Eigen::Vector3d p;      ///< in the camera, times the inverse depth
  Eigen::Vector2d slope;  ///< of p.head<2>() / p.z() over the inverse depth, times p.z()
};
RayProjection projectOnRay(const Eigen::Vector3d& ray, double inverse_depth,
                           const Eigen::Isometry3d& T_c_anchor);

/// Least squares over all observations (anchor's own excluded), Gauss-Newton on the reprojection
/// error. Empty when there is no observation, the point falls behind a camera, or the iteration
/// does not settle.
std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations);

}  // namespace ground_scale_vo
