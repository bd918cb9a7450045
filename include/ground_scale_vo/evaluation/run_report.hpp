#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace gsv {

/// The metrics of a run as one JSON object, null for missing values:
///   frames, tracked_frames, lost_events, backfilled_frames, camera_height_m [m]; smoothed: whether
///   scales and metric poses are those of RunRecord::smooth();
///   length_m [m] of the metric trajectory, length_sigma_m: RunRecord::lengthSigma();
///   the other members of OdometryMetrics under their names, of the metric trajectory (but
///   t_err_sim3_percent of the unscaled one); null without ground truth;
///   scale_within_2_sigma, first_scale_error_sigmas, scale_held_share, scale_error_median_percent,
///   height_bias_percent: of ScaleMetrics; null without ground truth, height_bias_percent also
///   without ground_truth_heights;
///   first_metric_pose_m, covariance_by_length: of CovarianceMetrics; null without ground truth;
///   ms_vo_median, ms_vo_p95 and the same for ms_scale_ and ms_total_: time per frame [ms], without
///   image reading;
///   peak_rss_mb: peak memory of this process [MiB].
/// ground_truth: T_c0_ci [m] of each frame, or empty. ground_truth_heights: of the camera above the
/// road [m] of each frame, or empty; where they are given, the ground truth counts as exact. Throws
/// OptionError when a size differs from the record's.
std::string metricsJson(const RunRecord& record, double camera_height,
                        const std::vector<Eigen::Isometry3d>& ground_truth,
                        const std::vector<double>& ground_truth_heights = {});

/// A line per frame with the output of the scale stage, and the map and status of the odometry.
///   stamp [s]; raw_scale, scale, sigma [m per VO unit]; height [VO units]; n: the plane's normal
///   in camera axes, upwards; backfilled: the pose was filled in later, with the first scale.
std::string scaleCsv(const RunRecord& record);

/// A line per frame with the time of each stage [ms], in the order in which they run; 0 where a
/// stage did not run. total is vo_total + scale_total: without decode, and without
/// vo_bundle_adjustment, which runs in parallel (VisualOdometry::Times).
std::string timingCsv(const RunRecord& record);

/// Creates the folder and writes into it poses.txt, poses_unscaled.txt, trajectory_tum.txt,
/// scale.csv and metrics.json; timing.csv unless every frame's total is NaN (times not known); with
/// ground truth also ground_truth.txt, for the plots. Throws DataError; OptionError as metricsJson.
void writeRun(const std::filesystem::path& folder, const RunRecord& record, double camera_height,
              const std::vector<Eigen::Isometry3d>& ground_truth,
              const std::vector<double>& ground_truth_heights = {});

}  // namespace gsv
