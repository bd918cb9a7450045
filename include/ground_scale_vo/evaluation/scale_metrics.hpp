#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// Errors of the estimated scale against the true scale. The true scale of a frame is the distance
/// between two ground truth positions around it over the distance between the same positions of the
/// odometry [m per VO unit]. A metric is NaN if no frame has its data.
struct ScaleMetrics {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  // Of the filtered scale, over the frames that have one and a true scale.
  double within_2_sigma = kNone;            ///< share whose true scale is within two reported sigma
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

}  // namespace ground_scale_vo
