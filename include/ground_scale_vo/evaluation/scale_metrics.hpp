#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// Errors of the estimated scale against the true scale. The true scale of a frame is the distance
/// between two ground truth positions around it over the distance between the same positions of the
/// odometry [m per VO unit]. NaN if no frame has the data of a metric.
struct ScaleMetrics {
  // Of the filtered scale, over the frames that have one and a true scale.
  double within_2_sigma = 0;            ///< share whose true scale is within two reported sigma
  double error_median_percent = 0;      ///< of scale / true - 1, signed
  double error_abs_median_percent = 0;  ///< of |scale / true - 1|

  /// 1.4826 MAD of raw_scale / true - 1 [%], over the frames that have both: the standard deviation
  /// of single-frame measurements, robust against outliers.
  double error_spread_percent = 0;
  double held_share = 0;  ///< of the frames from the first metric pose on: ScaleStatus::kHeld
  /// Median of (estimated height times true scale) / true height - 1 [%]: the bias of the plane's
  /// height alone.
  double height_bias_percent = 0;
};

/// Minimum ground truth distance for the true scale of a frame [m]. It is as short as the accuracy
/// of the ground truth allows, because the true scale drifts within it. Exact ground truth needs 2
/// m, for the noise of the odometry. KITTI's GPS/IMU poses differ from three odometries by 0.5 %
/// over 8 m and 0.3 % over 16 m, while those agree to 0.2 % (docs/explanation/accuracy.md); the
/// reported sigma is about 1 %.
constexpr double kExactGroundTruthDistance = 2;
constexpr double kMeasuredGroundTruthDistance = 16;

/// ground_truth: T_c0_ci [m] of each frame; distance_m: one of the above; ground_truth_heights: of
/// the camera above the road [m] of each frame, or empty. Throws OptionError when a size differs
/// from the record's or distance_m is not positive.
ScaleMetrics computeScaleMetrics(const RunRecord& record,
                                 const std::vector<Eigen::Isometry3d>& ground_truth,
                                 double distance_m,
                                 const std::vector<double>& ground_truth_heights = {});

}  // namespace ground_scale_vo
