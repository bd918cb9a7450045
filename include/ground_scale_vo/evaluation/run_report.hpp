#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// The figures of a run as one JSON object, null where there is none:
///   frames, tracked_frames, lost_events, backfilled_frames, camera_height_m [m];
///   length_m and OdometryMetrics' members under their names, of the metric trajectory (of these,
///   t_err_sim3_percent is of the trajectory up to scale); null without ground truth;
///   scale_within_2_sigma, scale_held_share, scale_error_median_percent,
///   scale_error_spread_percent, height_bias_percent: ScaleMetrics; all null without ground truth,
///   the last without true_heights; ms_vo_, ms_scale_, ms_total_ with median and p95 [ms] over all
///   frames, without image reading; peak_rss_mb of this process [MiB]; by_length, by_short_length:
///   arrays of OdometryMetrics::LengthError.
/// ground_truth: T_c0_ci [m] of each frame, or empty. true_heights: of the camera over the road [m]
/// of each frame, or empty; where they are known, the truth is exact. Throws OptionError when one
/// has another size.
std::string metricsJson(const RunRecord& record, double camera_height,
                        const std::vector<Eigen::Isometry3d>& ground_truth,
                        const std::vector<double>& true_heights = {});

/// One line a frame: what the scale stage said at that frame, and the odometry's map and status.
///   stamp [s]; raw_scale, scale, sigma [m per VO unit]; height [VO units]; n the plane's normal in
///   camera axes, up. backfilled: the frame's pose was filled in later, from the first scale.
std::string scaleCsv(const RunRecord& record);

/// One line a frame: the time of each stage [ms], in the order in which they run; 0 where a stage
/// did not run. total is vo_total + scale_total: without decode, and without
/// vo_bundle_adjustment, which runs beside them (VisualOdometry::Times).
std::string timingCsv(const RunRecord& record);

/// Makes the folder and writes into it poses.txt, poses_unscaled.txt, trajectory_tum.txt, scale.csv
/// and metrics.json; timing.csv unless every frame's total is NaN, which means that no times are
/// known; with ground truth also ground_truth.txt, for the pictures. Throws DataError; OptionError
/// as metricsJson.
void writeRun(const std::filesystem::path& folder, const RunRecord& record, double camera_height,
              const std::vector<Eigen::Isometry3d>& ground_truth,
              const std::vector<double>& true_heights = {});

}  // namespace ground_scale_vo
