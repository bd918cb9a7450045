#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/input/camera.hpp"

namespace ground_scale_vo {

enum class TwoViewStatus {
  kOk,
  kTooFewMatches,
  kTooLittleParallax,  ///< a rotation explains the matches: standstill or pure rotation
  kNoModel,            ///< no essential matrix or homography has enough inliers
  kAmbiguous           ///< several motions have about the same support
};

/// The rotation between two images: x_2 ~ R_2_1 x_1 + t.
struct RelativeRotation {
  Eigen::Matrix3d R_2_1 = Eigen::Matrix3d::Identity();
  double sigma = 0;  ///< standard deviation per axis [rad]
};

/// Distance of ray_2 from the epipolar line of ray_1 (z = 1), in normalised image coordinates.
double epipolarError(const Eigen::Isometry3d& T_2_1, const Eigen::Vector3d& ray_1,
                     const Eigen::Vector3d& ray_2);

/// The motion between two images of a static scene, up to scale, from matched pixels (Hartley &
/// Zisserman, ch. 9 and 13). Both an essential matrix and a homography are estimated, so a planar
/// scene needs no special case: the motions that either decomposes into are compared by the matches
/// that triangulate in front of both cameras with a small reprojection error.
class TwoView {
 public:
  struct Result {
    TwoViewStatus status = TwoViewStatus::kNoModel;
    Eigen::Isometry3d T_2_1 = Eigen::Isometry3d::Identity();  ///< |t| = 1; valid when kOk
    std::vector<bool> inlier;             ///< for each match: triangulated with depth > 0
    std::vector<double> inverse_depth_1;  ///< 1 / z in the first camera; valid where inlier
    double median_parallax = 0;           ///< [rad]
  };

  /// u1, u2: [px], same length. Deterministic.
  Result estimate(const PinholeCamera& camera, const std::vector<Eigen::Vector2d>& u1,
                  const std::vector<Eigen::Vector2d>& u2) const;

  /// The rotation alone, which needs neither parallax nor a unique translation. Empty when too few
  /// matches agree with one motion. Deterministic.
  std::optional<RelativeRotation> estimateRotation(const PinholeCamera& camera,
                                                   const std::vector<Eigen::Vector2d>& u1,
                                                   const std::vector<Eigen::Vector2d>& u2) const;
};

}  // namespace ground_scale_vo
