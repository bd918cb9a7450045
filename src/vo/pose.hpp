#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "vo/map.hpp"

namespace gsv {

/// A map point and its observation in a frame. Error of the point perpendicular to its ray is
/// neglected: one of uncertain depth still constrains the pose perpendicular to its epipolar line.
struct PointObservation : WorldPoint {
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
};
/// Those of the observed features that have a map point. index: filled with their indices in
/// `observations`, if not null.
std::vector<PointObservation> pointObservations(const LocalMap& map,
                                                const std::vector<Observation>& observations,
                                                std::vector<std::size_t>* index = nullptr);

struct PoseEstimate {
  bool ok = false;
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< valid when ok
  std::vector<bool> inlier;  ///< one per observation; empty when there are too few of these
  int inliers = 0;
  /// As VoFrame::pose_covariance: sigma^2 (J^T W J)^-1 with the Jacobian J and the weights
  /// W = 1 / variance of the inliers. sigma^2 is estimated from the residuals, so that it
  /// adapts to noise, blur and compression. Zero when it cannot be computed.
  Matrix6d covariance = Matrix6d::Zero();
};

/// A frame's pose from 2D-3D correspondences: robust Gauss-Newton (Geman-McClure) from the
/// predicted pose; when that fails or has few inliers, from the pose that RANSAC with P3P finds.
/// Deterministic. Fails with fewer inliers, a smaller share of them, or an implausible position.
PoseEstimate estimatePose(const Eigen::Isometry3d& predicted_T_w_c,
                          const std::vector<PointObservation>& observations, int min_inliers = 25,
                          double min_inlier_share = 0.4);

}  // namespace gsv
