#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

namespace ground_scale_vo {

/// Errors of an estimated trajectory against ground truth, both T_c0_ci in metres, one pose a
/// frame.
struct OdometryMetrics {
  double length_m = 0;
  double gt_length_m = 0;
  std::optional<double> rle_percent;  ///< relative length error; empty when the truth stands
  /// KITTI devkit: lengths 100, 200 ... 800 m, a start every 10 frames, the end the first frame
  /// farther than the length along the true path; mean over all segments. Empty when there is none.
  std::optional<double> t_err_percent;
  std::optional<double> r_err_deg_per_m;
  std::optional<double> t_err_short_percent;  ///< the same over 10, 20 ... 80 m
  /// t_err_percent with the length of each of the estimate's increments replaced by the true one's;
  /// rotations and directions stay. What is left is not the scale's fault. An increment of zero
  /// length has no direction and stays zero.
  std::optional<double> t_err_true_length_percent;
  /// t_err_percent after the one similarity that brings the estimate's positions nearest to the
  /// true ones (least squares). Also for estimates up to scale. Empty too when the estimate stands.
  std::optional<double> t_err_sim3_percent;
  /// Median angle between the estimated and the true direction of motion since the previous frame,
  /// each in its own trajectory's camera axes of that previous frame [deg], over the frames with
  /// more than 0.3 m of true motion and any estimated. Empty when there is none.
  std::optional<double> direction_median_deg;
  double ate_rmse_m = 0;  ///< position, after the best rigid alignment (no scale)

  struct LengthError {
    double length_m = 0;
    int segments = 0;
    double t_err_percent = 0;
    double r_err_deg_per_m = 0;
  };
  std::vector<LengthError> by_length;        ///< devkit lengths that have a segment
  std::vector<LengthError> by_short_length;  ///< of 10, 20 ... 80 m, those that have a segment
};

/// Throws OptionError when the sizes differ, there are fewer than two poses, or one is not
/// finite or farther off than a camera can be.
OdometryMetrics computeOdometryMetrics(const std::vector<Eigen::Isometry3d>& ground_truth,
                                       const std::vector<Eigen::Isometry3d>& estimate);

/// How far two trajectories of the same frames disagree in rotation: R_i^T R_(i + frames) is the
/// camera's rotation over `frames` frames, and this is the largest angle between the two's, over
/// every i [deg]. Positions, scale and the worlds' axes do not count. Empty when there are not more
/// than `frames` poses. Throws OptionError when the sizes differ, `frames` is 0, or a pose is not
/// finite.
std::optional<double> largestRotationDifferenceDeg(const std::vector<Eigen::Isometry3d>& first,
                                                   const std::vector<Eigen::Isometry3d>& second,
                                                   std::size_t frames);

/// Sum of the distances between neighbouring positions.
double pathLength(const std::vector<Eigen::Isometry3d>& poses);

/// The q-quantile (q in [0, 1]), linear between neighbours; the median for 0.5. NaN when empty.
double quantile(std::vector<double> values, double q);

}  // namespace ground_scale_vo
