#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <optional>
#include <vector>

namespace ground_scale_vo {

/// A point on the ray of its anchor camera: p_anchor = ray / inverse_depth, ray.z() = 1.
struct InverseDepth {
  double value = 0;  ///< 1 / z in the anchor camera
  double sigma = 0;  ///< standard deviation of value
};

/// Observation of a point on the ray of an anchor camera by another camera c.
struct RayObservation {
  Eigen::Isometry3d T_c_anchor = Eigen::Isometry3d::Identity();
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
};

/// Projection of a point on the anchor's ray into camera c: p = R_c_anchor ray + inverse_depth t.
struct RayProjection {
  Eigen::Vector3d p;  ///< the point in camera c, times its inverse depth in the anchor
  /// p.z() times the derivative of p.head<2>() / p.z() with respect to the inverse depth.
  Eigen::Vector2d scaled_derivative;
};
inline RayProjection projectOnRay(const Eigen::Vector3d& ray, double inverse_depth,
                                  const Eigen::Isometry3d& T_c_anchor) {
  const Eigen::Vector3d& t = T_c_anchor.translation();
  const Eigen::Vector3d p = T_c_anchor.linear() * ray + inverse_depth * t;
  return {p, t.head<2>() - p.head<2>() / p.z() * t.z()};
}

/// Minimum depth in the observer relative to the depth in the anchor; a point with a smaller ratio
/// is treated as behind the camera.
constexpr double kMinObserverDepthRatio = 1e-6;

/// Distance between the projection of a point and its observation x, in normalised image
/// coordinates; infinite behind the camera.
inline double reprojectionError(const Eigen::Vector3d& p, const Eigen::Vector2d& x) {
  return p.z() > kMinObserverDepthRatio ? (p.head<2>() / p.z() - x).norm()
                                        : std::numeric_limits<double>::infinity();
}

/// Inverse depth with the least squared reprojection error in all observations (without the
/// anchor's own), by Gauss-Newton. ray: in the anchor, z = 1. Empty when there is no observation or
/// no baseline, the point is behind an observing camera, or the iteration does not converge. The
/// value may be zero or negative: a point at infinity, or behind the anchor.
std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations);

}  // namespace ground_scale_vo
