#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"

namespace gsv {

/// Errors of an estimated trajectory against ground truth, both T_c0_ci in metres, one pose per
/// frame.
struct OdometryMetrics {
  double length_m = 0;
  double gt_length_m = 0;
  std::optional<double>
      rle_percent;  ///< relative length error; empty when the ground truth does not move
  /// KITTI devkit: segments of 100, 200 ... 800 m that start every 10 frames and end at the first
  /// frame farther than the length along the ground truth path; mean over all segments. Empty if
  /// there is no such segment.
  std::optional<double> t_err_percent;
  std::optional<double> r_err_deg_per_m;
  std::optional<double> t_err_short_percent;  ///< the same over 10, 20 ... 80 m
  /// t_err_percent caused by rotation and direction only: the step lengths are taken from the
  /// ground truth. A step of zero length stays zero.
  std::optional<double> t_err_true_length_percent;
  /// t_err_percent after Sim(3) alignment (Umeyama) of the estimated to the ground truth positions.
  /// Valid for estimates up to scale. Empty also when the estimate does not move.
  std::optional<double> t_err_sim3_percent;
  double ate_rmse_m = 0;  ///< RMS position error after SE(3) alignment (Umeyama without scale)
};

/// Throws OptionError when the sizes differ, there are fewer than two poses, or one is not
/// finite or implausibly far away.
OdometryMetrics computeOdometryMetrics(const std::vector<Eigen::Isometry3d>& ground_truth,
                                       const std::vector<Eigen::Isometry3d>& estimate);

/// Path length up to each pose.
std::vector<double> distancesTravelled(const std::vector<Eigen::Isometry3d>& poses);

/// Sum of the distances between consecutive positions.
double pathLength(const std::vector<Eigen::Isometry3d>& poses);

/// The q-quantile (q in [0, 1]) with linear interpolation between order statistics. NaN if empty.
double quantile(std::vector<double> values, double q);

/// Errors of the estimated scale against the true scale. The true scale of a frame is the distance
/// between two ground truth positions around it over the distance between the same positions of the
/// odometry [m per VO unit]. A metric is NaN if no frame has its data.
struct ScaleMetrics {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  // Errors of the filtered scale, over the frames that have one and a true scale.
  double nees = kNone;            ///< mean of the squared error in reported sigma; consistent: 1
  double within_2_sigma = kNone;  ///< share whose true scale is within two reported sigma
  double error_median_percent = kNone;      ///< of scale / true - 1, signed
  double error_abs_median_percent = kNone;  ///< of |scale / true - 1|
  double first_error_sigmas = kNone;        ///< (scale - true) / sigma of the first of these frames
  double held_share = kNone;  ///< share of frames with kHeld, from the first metric pose on
  /// Median of (estimated height times true scale) / true height - 1 [%]: the bias of the plane's
  /// height alone.
  double height_bias_percent = kNone;
};

/// Minimum ground truth distance for the true scale of a frame [m]. As short as possible,
/// because the scale of the odometry drifts over the distance. With exact ground truth 2 m suffice
/// to average the noise of the odometry. Over 8 m, DSO, OV2SLAM and this odometry agree to 0.2 to
/// 0.4 %, but each differs from KITTI's GPS/IMU poses by 0.5 % (docs/explanation/accuracy.md).
constexpr double kExactGroundTruthDistance = 2;
constexpr double kMeasuredGroundTruthDistance = 16;

/// ground_truth: T_c0_ci [m] of each frame; distance_m: > 0, normally one of the above;
/// ground_truth_heights: of the camera above the road [m] of each frame, or empty. Throws
/// OptionError when a size differs from the record's or distance_m is not positive.
ScaleMetrics computeScaleMetrics(const RunRecord& record,
                                 const std::vector<Eigen::Isometry3d>& ground_truth,
                                 double distance_m,
                                 const std::vector<double>& ground_truth_heights = {});

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
/// positive definite; then e_i and e_j count as independent: P = P_j + F P_i F^T. The error of the
/// camera height is a constant factor instead: it is left out of P_i and P_j, and its share of the
/// motion from i to j added. The covariance of the ground truth's relative pose is added to P.
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
  /// Relative poses over one length: from every frame with a metric pose at least 1 m of ground
  /// truth path after the start of the previous segment, to the first frame with a metric
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

}  // namespace gsv
