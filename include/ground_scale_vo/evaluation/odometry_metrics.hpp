#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

namespace ground_scale_vo {

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

}  // namespace ground_scale_vo
