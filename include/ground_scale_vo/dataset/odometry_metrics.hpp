#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace ground_scale_vo {

/// Errors of an estimated trajectory against ground truth, both T_c0_ci in metres, one pose a frame.
struct OdometryMetrics {
  double length_m = 0;
  double gt_length_m = 0;
  double rle_percent = 0;  ///< relative length error |l_gt - l| / l_gt
  /// KITTI devkit: lengths 100, 200 ... 800 m, a start every 10 frames, the end the first frame
  /// farther than the length along the true path; mean over all segments. Empty when there is none.
  std::optional<double> t_err_percent;
  std::optional<double> r_err_deg_per_m;
  std::optional<double> t_err_short_percent;  ///< the same over 10, 20 ... 80 m
  double ate_rmse_m = 0;  ///< position, after the best rigid alignment (no scale)

  struct LengthError {
    double length_m = 0;
    int segments = 0;
    double t_err_percent = 0;
    double r_err_deg_per_m = 0;
  };
  std::vector<LengthError> by_length;  ///< devkit lengths that have a segment
};

/// Throws OptionError when the sizes differ or there are fewer than two poses, or one is not finite.
OdometryMetrics computeOdometryMetrics(const std::vector<Eigen::Isometry3d>& ground_truth,
                                       const std::vector<Eigen::Isometry3d>& estimate);

}  // namespace ground_scale_vo
