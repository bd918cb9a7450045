#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "vo/map.hpp"

namespace ground_scale_vo {

/// A map point and its observation in a frame.
struct PointObservation {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  /// One standard deviation of p_w, along the anchor's ray. Error perpendicular to the ray is
  /// neglected. A point of uncertain depth still constrains the pose perpendicular to its epipolar
  /// line.
  Eigen::Vector3d sigma_w = Eigen::Vector3d::Zero();
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
};

/// The corners that have a map point. index: filled with their indices in `corners`, if not null.
std::vector<PointObservation> pointObservations(const LocalMap& map,
                                                const std::vector<Observation>& corners,
                                                std::vector<std::size_t>* index = nullptr);

enum class PoseStatus { kOk, kTooFewPoints, kTooFewInliers };

/// A frame's pose from 2D-3D correspondences: robust Gauss-Newton (Geman-McClure) from the
/// predicted pose; when that fails or has few inliers, from the pose that RANSAC with P3P finds.
class PoseEstimation {
 public:
  struct Result {
    PoseStatus status = PoseStatus::kTooFewPoints;
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< valid when kOk
    std::vector<bool> inlier;  ///< one per observation; empty when kTooFewPoints
    int inliers = 0;
    /// As VoFrame::pose_covariance: sigma^2 (J^T W J)^-1 with the Jacobian J and the weights
    /// W = 1 / variance of the inliers. sigma^2 is estimated from the residuals, so that it
    /// adapts to noise, blur and compression. Zero when it cannot be computed.
    Matrix6d covariance = Matrix6d::Zero();
  };

  /// An estimate needs this number of inliers, and this share of the observations.
  explicit PoseEstimation(int min_inliers = 25, double min_inlier_share = 0.4)
      : min_inliers_(min_inliers), min_inlier_share_(min_inlier_share) {}

  /// Deterministic. Fails with kTooFewPoints if there are too few observations, and with
  /// kTooFewInliers if there are too few inliers or the position is implausibly far away.
  Result estimate(const Eigen::Isometry3d& predicted_T_w_c,
                  const std::vector<PointObservation>& observations) const;

 private:
  Result refine(const Eigen::Isometry3d& start_T_w_c,
                const std::vector<PointObservation>& observations) const;

  int min_inliers_;
  double min_inlier_share_;
};

}  // namespace ground_scale_vo
