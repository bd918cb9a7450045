#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// How right the scale is, and whether its sigma says so. A frame's true scale is the true way over
/// the odometry's around that frame, both as chords. NaN where no frame has what a figure needs.
struct ScaleMetrics {
  // Of the scale in use, over the frames that have one and a true scale.
  double within_2_sigma = 0;            ///< share whose true scale lies within two reported sigma
  double error_median_percent = 0;      ///< of scale / true - 1, signed
  double error_abs_median_percent = 0;  ///< of |scale / true - 1|

  /// 1.4826 MAD of raw_scale / true - 1 [%], over the frames that have both: the noise of a frame
  /// by itself, about a normal distribution's sigma.
  double error_spread_percent = 0;
  double held_share = 0;  ///< of the frames from the first metric pose on: ScaleStatus::kHeld
  /// Median of (the estimated height times the true scale) / true height - 1 [%]: where the plane
  /// is thought to lie, the scale being perfect.
  double height_bias_percent = 0;
};

/// Shortest way for a frame's true scale [m]. The drift of the odometry's unit is to be seen in it,
/// so it is as short as the truth allows: exact poses need no more than the odometry's own noise
/// does. KITTI's GPS/IMU poses disagree with three odometries by 0.5 % over 8 m and 0.3 % over 16
/// m, while those agree to 0.2 % (docs/accuracy.md); sigma is about 1 %.
constexpr double kWayOfExactTruth = 2;
constexpr double kWayOfMeasuredTruth = 16;  ///< 8 m before and 8 m after the frame

/// truth: T_c0_ci [m] of each frame; true_heights: of the camera over the road [m] of each frame,
/// or empty. Throws OptionError when a size differs from the record's or way_m is not positive.
ScaleMetrics computeScaleMetrics(const RunRecord& record,
                                 const std::vector<Eigen::Isometry3d>& truth, double way_m,
                                 const std::vector<double>& true_heights = {});

}  // namespace ground_scale_vo
