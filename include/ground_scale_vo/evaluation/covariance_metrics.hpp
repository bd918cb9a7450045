#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// Standard deviations of a ground truth, for drives on which it is not exact.
struct GroundTruthAccuracy {
  double position_sigma = 0;   ///< [m] of each position, per axis
  double rotation_sigma = 0;   ///< [rad] of each orientation, per axis
  double alignment_sigma = 0;  ///< [rad] of the constant rotation between its axes and the camera's
};
/// KITTI's GPS/IMU, an OXTS RT3003 with RTK corrections. Position: less than 5 cm under an open sky
/// (Geiger, Lenz, Urtasun, CVPR 2012). Orientation: 0.1 deg (Geiger, Lenz, Stiller, Urtasun, IJRR
/// 2013). The accuracy of the calibration of the camera to the GPS/IMU is not published; the value
/// is measured (docs/explanation/accuracy.md).
constexpr GroundTruthAccuracy kGpsImuAccuracy{0.05, 0.1 * kRadiansPerDegree, 0.004};

/// The error of the pose of frame j relative to frame i, and its covariance, both in o axes:
/// position [m], then rotation [rad], as in MetricPose. error: true minus estimated.
///
/// The covariance P of the relative pose follows from the published accumulated covariances P_i and
/// P_j. The error of the pose i moves the pose j rigidly, by F e_i with F = [I, -skew(p_j - p_i);
/// 0, I], and the motion from i to j adds its own error. If this error is independent of e_i,
/// P = P_j - F P_i F^T. (The errors of the scale shortly before and after i are correlated, so P is
/// too large along the direction of motion: over 10 m up to 2.7 times.) Where the scale, and
/// with it the position, is known better at j than at i, the difference may be singular or not
/// positive definite; then e_i and e_j count as independent: P = P_j + F P_i F^T. The covariance of
/// the ground truth's relative pose is added to P.
struct RelativePoseError {
  Vector6d error;
  Matrix6d covariance;
};

/// Precondition: both frames have a metric pose. ground_truth: T_c0_ci [m] of each frame.
RelativePoseError relativePoseError(const RunRecord& record,
                                    const std::vector<Eigen::Isometry3d>& ground_truth,
                                    std::size_t i, std::size_t j,
                                    const GroundTruthAccuracy& accuracy = {});

/// Consistency of the published covariances with the errors.
struct CovarianceMetrics {
  /// Of the relative poses over one length: from every frame with a metric pose at least 1 m of
  /// ground truth path after the start of the previous segment, to the first frame with a metric
  /// pose farther along the ground truth path than the length. The frames in between may be without
  /// a pose.
  struct Length {
    double length_m = 0;
    int segments = 0;
    /// Mean of the normalised estimation error squared, e^T P^-1 e, over the six degrees of
    /// freedom: 1 for a consistent covariance, more for an overconfident one.
    double nees_per_dof = 0;
    double within_2_sigma = 0;  ///< share of the six components of all errors; consistent: 0.95
  };
  std::vector<Length> by_length;  ///< of 10, 50 and 100 m, those that have a segment
  /// Ground truth path length up to the first metric pose; NaN without one.
  double first_metric_pose_m = std::numeric_limits<double>::quiet_NaN();
};

/// ground_truth: T_c0_ci [m] of each frame. Throws OptionError when its size differs from the
/// record's.
CovarianceMetrics computeCovarianceMetrics(const RunRecord& record,
                                           const std::vector<Eigen::Isometry3d>& ground_truth,
                                           const GroundTruthAccuracy& accuracy = {});

}  // namespace ground_scale_vo
