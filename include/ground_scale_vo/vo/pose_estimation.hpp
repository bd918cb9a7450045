#pragma once

#include <Eigen/Geometry>
#include <vector>

namespace ground_scale_vo {

/// A map point and where this frame sees it.
struct PointObservation {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  /// One standard deviation of p_w; its uncertainty is along this line alone (the anchor's ray), so
  /// a point of unsure depth still tells where it is not: off its epipolar line.
  Eigen::Vector3d sigma_w = Eigen::Vector3d::Zero();
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
};

enum class PoseStatus { kOk, kTooFewPoints, kTooFewInliers };

/// A frame's pose from 2D-3D correspondences: robust Gauss-Newton from a prediction, and a
/// RANSAC (P3P) start when the prediction is no good.
class PoseEstimation {
 public:
  struct Options {
    double noise = 0.0008;      ///< standard deviation of x
    double inlier_sigma = 3.5;  ///< Mahalanobis distance of an inlier
    int min_inliers = 25;
    double min_inlier_share = 0.4;  ///< of the given points
    int max_iterations = 15;
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    PoseStatus status = PoseStatus::kTooFewPoints;
    Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< meaningful when kOk
    std::vector<bool> inlier;                                 ///< for each observation
    int inliers = 0;
  };

  explicit PoseEstimation(const Options& options);

  /// Deterministic.
  Result estimate(const Eigen::Isometry3d& predicted_T_w_c,
                  const std::vector<PointObservation>& observations) const;

 private:
  Result refine(const Eigen::Isometry3d& start_T_w_c,
                const std::vector<PointObservation>& observations) const;

  Options options_;
};

}  // namespace ground_scale_vo
