#include "ground_scale_vo/evaluation/run_report.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <locale>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <utility>

#include "ground_scale_vo/common/text_file.hpp"
#include "ground_scale_vo/evaluation/covariance_metrics.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/scale_metrics.hpp"
#include "ground_scale_vo/io/csv_stream.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

using Poses = std::vector<Eigen::Isometry3d>;
using Json = nlohmann::ordered_json;

/// A number with 10 significant digits; null if it is missing or not finite.
Json number(std::optional<double> value) {
  if (!value || !std::isfinite(*value)) return nullptr;
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << std::setprecision(10) << *value;
  return Json::parse(text.str());
}

/// A member of metrics; null without metrics.
template <typename Metrics, typename Field>
Json member(const std::optional<Metrics>& metrics, Field field) {
  return metrics ? number((*metrics).*field) : Json(nullptr);
}

Json lengthErrors(const std::vector<OdometryMetrics::LengthError>& errors) {
  Json array = Json::array();
  for (const OdometryMetrics::LengthError& error : errors) {
    array.push_back({{"length_m", number(error.length_m)},
                     {"segments", error.segments},
                     {"t_err_percent", number(error.t_err_percent)},
                     {"r_err_deg_per_m", number(error.r_err_deg_per_m)}});
  }
  return array;
}

double voTime(const RunFrame& frame) { return frame.vo_times.total; }
double scaleTime(const RunFrame& frame) { return frame.scale_times.total; }
double totalTime(const RunFrame& frame) { return voTime(frame) + scaleTime(frame); }

/// Times of the frames for which they are known [ms].
std::vector<double> timesOf(const RunRecord& record, double (*time)(const RunFrame&)) {
  std::vector<double> times;
  for (const RunFrame& frame : record.frames()) {
    if (std::isfinite(time(frame))) times.push_back(time(frame));
  }
  return times;
}

void addFrameCounts(const RunRecord& record, Json* json) {
  const std::vector<RunFrame>& frames = record.frames();
  (*json)["frames"] = frames.size();
  (*json)["tracked_frames"] = record.trackedFrames();
  (*json)["lost_events"] = record.lostEvents();
  (*json)["backfilled_frames"] = std::count_if(
      frames.begin(), frames.end(), [](const RunFrame& frame) { return frame.backfilled; });
}

void addTrajectoryMetrics(const std::optional<OdometryMetrics>& metric,
                          const std::optional<OdometryMetrics>& unscaled, Json* json) {
  using Metrics = OdometryMetrics;
  Json& members = *json;
  members["gt_length_m"] = member(metric, &Metrics::gt_length_m);
  members["rle_percent"] = member(metric, &Metrics::rle_percent);
  members["t_err_percent"] = member(metric, &Metrics::t_err_percent);
  members["r_err_deg_per_m"] = member(metric, &Metrics::r_err_deg_per_m);
  members["t_err_short_percent"] = member(metric, &Metrics::t_err_short_percent);
  members["t_err_true_length_percent"] = member(metric, &Metrics::t_err_true_length_percent);
  members["t_err_sim3_percent"] = member(unscaled, &Metrics::t_err_sim3_percent);
  members["direction_median_deg"] = member(metric, &Metrics::direction_median_deg);
  members["ate_rmse_m"] = member(metric, &Metrics::ate_rmse_m);
}

void addScaleMetrics(const std::optional<ScaleMetrics>& scale, Json* json) {
  Json& members = *json;
  members["scale_within_2_sigma"] = member(scale, &ScaleMetrics::within_2_sigma);
  members["first_scale_error_sigmas"] = member(scale, &ScaleMetrics::first_error_sigmas);
  members["scale_held_share"] = member(scale, &ScaleMetrics::held_share);
  members["scale_error_median_percent"] = member(scale, &ScaleMetrics::error_median_percent);
  members["scale_error_spread_percent"] = member(scale, &ScaleMetrics::error_spread_percent);
  members["height_bias_percent"] = member(scale, &ScaleMetrics::height_bias_percent);
}

void addCovarianceMetrics(const std::optional<CovarianceMetrics>& covariance, Json* json) {
  (*json)["first_metric_pose_m"] =
      covariance ? number(covariance->first_metric_pose_m) : Json(nullptr);
  (*json)["covariance_by_length"] = nullptr;
  if (!covariance) return;
  Json array = Json::array();
  for (const CovarianceMetrics::Length& length : covariance->by_length) {
    array.push_back(
        {{"length_m", number(length.length_m)},
         {"segments", length.segments},
         {"nees_per_dof", number(length.nees_per_dof)},
         {"nees_per_dof_exact_ground_truth", number(length.nees_per_dof_exact_ground_truth)},
         {"within_2_sigma", number(length.within_2_sigma)}});
  }
  (*json)["covariance_by_length"] = array;
}

void addResources(const RunRecord& record, Json* json) {
  const std::pair<const char*, double (*)(const RunFrame&)> stages[] = {
      {"ms_vo", voTime}, {"ms_scale", scaleTime}, {"ms_total", totalTime}};
  for (const auto& [name, time] : stages) {
    const std::vector<double> times = timesOf(record, time);
    (*json)[std::string(name) + "_median"] = number(quantile(times, 0.5));
    (*json)[std::string(name) + "_p95"] = number(quantile(times, 0.95));
  }
  (*json)["peak_rss_mb"] = number(processUsage().peak_rss_mb);
}

}  // namespace

std::string metricsJson(const RunRecord& record, double camera_height, const Poses& ground_truth,
                        const std::vector<double>& ground_truth_heights) {
  const Poses metric_poses = record.metricPoses();
  std::optional<OdometryMetrics> metric, unscaled;
  std::optional<ScaleMetrics> scale;
  std::optional<CovarianceMetrics> covariance;
  if (!ground_truth.empty() && metric_poses.size() >= 2) {
    metric = computeOdometryMetrics(ground_truth, metric_poses);
    unscaled = computeOdometryMetrics(ground_truth, record.unscaledPoses());
    const bool is_exact = !ground_truth_heights.empty();
    covariance = computeCovarianceMetrics(record, ground_truth,
                                          is_exact ? GroundTruthAccuracy{} : kGpsImuAccuracy);
    scale = computeScaleMetrics(record, ground_truth,
                                is_exact ? kExactGroundTruthDistance : kMeasuredGroundTruthDistance,
                                ground_truth_heights);
  }
  Json json;
  addFrameCounts(record, &json);
  json["camera_height_m"] = number(camera_height);
  json["length_m"] = number(pathLength(metric_poses));
  addTrajectoryMetrics(metric, unscaled, &json);
  addScaleMetrics(scale, &json);
  addCovarianceMetrics(covariance, &json);
  addResources(record, &json);
  json["by_length"] = metric ? lengthErrors(metric->by_length) : Json(nullptr);
  json["by_short_length"] = metric ? lengthErrors(metric->by_short_length) : Json(nullptr);
  return json.dump(2) + "\n";
}

std::string scaleCsv(const RunRecord& record) {
  std::ostringstream stream = csvStream(
      "frame,stamp,status,reason,raw_scale,scale,sigma,height,nx,ny,nz,triangles,"
      "ground_triangles,ground_points,window_points,plane_inliers,backfilled,map_id,vo_status");
  for (std::size_t i = 0; i < record.frames().size(); ++i) {
    const RunFrame& frame = record.frames()[i];
    const ScaleEstimate& s = frame.scale;
    stream << i << ',' << formatSeconds(frame.stamp_ns) << ',' << toString(s.status) << ','
           << toString(s.measurement) << ',' << s.raw_scale << ',' << s.scale << ',' << s.sigma
           << ',' << s.height << ',' << s.n_c.x() << ',' << s.n_c.y() << ',' << s.n_c.z() << ','
           << s.triangles << ',' << s.ground_triangles << ',' << s.ground_points << ','
           << s.window_points << ',' << s.plane_inliers << ',' << frame.backfilled << ','
           << frame.map_id << ',' << toString(frame.vo_status) << '\n';
  }
  return stream.str();
}

std::string timingCsv(const RunRecord& record) {
  std::ostringstream stream = csvStream(
      "frame,decode,vo_pyramid,vo_track,vo_adjustment_wait,vo_align,vo_pose,vo_detect,"
      "vo_triangulate,vo_bundle_adjustment,vo_total,scale_delaunay,scale_gpe,scale_gpa,"
      "scale_direct,scale_filter,scale_total,total");
  for (std::size_t i = 0; i < record.frames().size(); ++i) {
    const RunFrame& frame = record.frames()[i];
    const VisualOdometry::Times& vo = frame.vo_times;
    const ScaleRecovery::Times& scale = frame.scale_times;
    stream << i << ',' << frame.decode_ms << ',' << vo.pyramid << ',' << vo.track << ','
           << vo.adjustment_wait << ',' << vo.align << ',' << vo.pose << ',' << vo.detect << ','
           << vo.triangulate << ',' << vo.bundle_adjustment << ',' << vo.total << ','
           << scale.delaunay << ',' << scale.gpe << ',' << scale.gpa << ',' << scale.direct << ','
           << scale.filter << ',' << scale.total << ',' << totalTime(frame) << '\n';
  }
  return stream.str();
}

void writeRun(const fs::path& folder, const RunRecord& record, double camera_height,
              const std::vector<Eigen::Isometry3d>& ground_truth,
              const std::vector<double>& ground_truth_heights) {
  makeFolder(folder);
  for (const char* name : {"timing.csv", "ground_truth.txt"}) {  // of an earlier run
    std::error_code ignored;
    fs::remove(folder / name, ignored);
  }
  const auto metric_poses = record.metricPoses();
  std::vector<StampedPose> stamped;
  for (std::size_t i = 0; i < metric_poses.size(); ++i) {
    stamped.push_back({record.frames()[i].stamp_ns, metric_poses[i]});
  }
  writeKittiPoses(folder / "poses.txt", metric_poses);
  writeKittiPoses(folder / "poses_unscaled.txt", record.unscaledPoses());
  writeTumTrajectory(folder / "trajectory_tum.txt", stamped);
  writeFile(folder / "scale.csv", scaleCsv(record));
  if (!timesOf(record, voTime).empty()) {
    writeFile(folder / "timing.csv", timingCsv(record));
  }
  writeFile(folder / "metrics.json",
            metricsJson(record, camera_height, ground_truth, ground_truth_heights));
  if (!ground_truth.empty()) writeKittiPoses(folder / "ground_truth.txt", ground_truth);
}

}  // namespace ground_scale_vo
