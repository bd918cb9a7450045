#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// The rotation between two images: x_2 ~ R_2_1 x_1 + t.
struct RelativeRotation {
  Eigen::Matrix3d R_2_1 = Eigen::Matrix3d::Identity();
  /// Standard deviation per axis [rad]; infinite: unknown.
  double sigma = std::numeric_limits<double>::infinity();

  /// The rotation between the images 1 and 3; unknown if one of both is.
  RelativeRotation then(const RelativeRotation& from_2_to_3) const {
    return {from_2_to_3.R_2_1 * R_2_1, std::hypot(sigma, from_2_to_3.sigma)};
  }
};

/// The motion between two images, up to scale.
struct TwoViewMotion {
  Eigen::Isometry3d T_2_1 = Eigen::Isometry3d::Identity();  ///< |t| = 1
  std::vector<bool> inlier;             ///< for each match: triangulated with depth > 0
  std::vector<double> inverse_depth_1;  ///< 1 / z in the first camera; valid where inlier
  int inliers = 0;  ///< matches that fit, also those whose inverse depth is not positive from noise
  double cost = 0;  ///< sum of squared errors, truncated at 1, in units of the inlier threshold
};

/// The motion between two images of a static scene from matched pixels u1, u2 [px] (Hartley &
/// Zisserman, ch. 9 and 13). Both an essential matrix and a homography are estimated, so a planar
/// scene needs no special case: the motions that either decomposes into are compared by the matches
/// that triangulate in front of both cameras with a small reprojection error. Empty when there are
/// few matches or inliers, when a rotation explains the matches (standstill), or when several
/// motions have about the same support. Deterministic.
std::optional<TwoViewMotion> estimateMotion(const PinholeCamera& camera,
                                            const std::vector<Eigen::Vector2d>& u1,
                                            const std::vector<Eigen::Vector2d>& u2);

/// The rotation alone, which needs neither parallax nor a unique translation. Unknown when too few
/// matches agree with one motion. Deterministic.
RelativeRotation estimateRotation(const PinholeCamera& camera,
                                  const std::vector<Eigen::Vector2d>& u1,
                                  const std::vector<Eigen::Vector2d>& u2);

/// Distance of ray_2 from the epipolar line of ray_1 (z = 1), in normalised image coordinates.
double epipolarError(const Eigen::Isometry3d& T_2_1, const Eigen::Vector3d& ray_1,
                     const Eigen::Vector3d& ray_2);

}  // namespace gsv
