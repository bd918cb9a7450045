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
  /// Median angle between the estimated and the true direction of motion since the previous frame,
  /// each in the previous camera frame of its own trajectory [deg], over the frames whose true
  /// motion exceeds 0.3 m and whose estimated motion is nonzero. Empty if there is no such frame.
  std::optional<double> direction_median_deg;
  double ate_rmse_m = 0;  ///< RMS position error after SE(3) alignment (Umeyama without scale)

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
/// finite or implausibly far away.
OdometryMetrics computeOdometryMetrics(const std::vector<Eigen::Isometry3d>& ground_truth,
                                       const std::vector<Eigen::Isometry3d>& estimate);

/// The largest angle over all i [deg] between the camera rotations R_i^T R_(i + frames) of two
/// trajectories of the same frames. Independent of positions, scale and world frame. Empty when
/// there are at most `frames` poses. Throws OptionError when the sizes differ, `frames` is 0, or a
/// pose is not finite or implausibly far away.
std::optional<double> largestRotationDifferenceDeg(const std::vector<Eigen::Isometry3d>& first,
                                                   const std::vector<Eigen::Isometry3d>& second,
                                                   std::size_t frames);

/// Path length up to each pose.
std::vector<double> distancesTravelled(const std::vector<Eigen::Isometry3d>& poses);

/// Sum of the distances between consecutive positions.
double pathLength(const std::vector<Eigen::Isometry3d>& poses);

/// The q-quantile (q in [0, 1]) with linear interpolation between order statistics. NaN if empty.
double quantile(std::vector<double> values, double q);

}  // namespace ground_scale_vo
