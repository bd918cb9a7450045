#include "ground_scale_vo/evaluation/run_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <utility>

#include "common/files.hpp"
#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

/// null if it is missing.
Json number(std::optional<double> value) { return value ? Json(*value) : Json(nullptr); }

/// To ten significant digits: the last ones depend on how a program was compiled.
void roundNumbers(Json* json) {
  if (json->is_structured()) {
    for (Json& child : *json) roundNumbers(&child);
  } else if (json->is_number_float()) {
    const auto value = json->get<double>();
    *json = std::isfinite(value) ? Json::parse(format("%.10g", value)) : Json(nullptr);
  }
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

void addTrajectoryMetrics(const OdometryMetrics& metric, const OdometryMetrics& unscaled,
                          Json* json) {
  (*json)["gt_length_m"] = metric.gt_length_m;
  (*json)["rle_percent"] = number(metric.rle_percent);
  (*json)["t_err_percent"] = number(metric.t_err_percent);
  (*json)["r_err_deg_per_m"] = number(metric.r_err_deg_per_m);
  (*json)["t_err_short_percent"] = number(metric.t_err_short_percent);
  (*json)["t_err_true_length_percent"] = number(metric.t_err_true_length_percent);
  (*json)["t_err_sim3_percent"] = number(unscaled.t_err_sim3_percent);
  (*json)["ate_rmse_m"] = metric.ate_rmse_m;
}

void addScaleMetrics(const ScaleMetrics& scale, Json* json) {
  (*json)["scale_within_2_sigma"] = scale.within_2_sigma;
  (*json)["scale_nees"] = scale.nees;
  (*json)["first_scale_error_sigmas"] = scale.first_error_sigmas;
  (*json)["scale_held_share"] = scale.held_share;
  (*json)["scale_error_median_percent"] = scale.error_median_percent;
  (*json)["height_bias_percent"] = scale.height_bias_percent;
}

void addCovarianceMetrics(const CovarianceMetrics& covariance, Json* json) {
  (*json)["first_metric_pose_m"] = covariance.first_metric_pose_m;
  Json& array = (*json)["covariance_by_length"] = Json::array();
  for (const CovarianceMetrics::Length& length : covariance.by_length) {
    array.push_back({{"length_m", length.length_m},
                     {"segments", length.segments},
                     {"nees_per_dof", length.nees_per_dof},
                     {"within_2_sigma", length.within_2_sigma}});
  }
}

}  // namespace

std::string metricsJson(const RunRecord& record, double camera_height,
                        const std::vector<Eigen::Isometry3d>& ground_truth,
                        const std::vector<double>& ground_truth_heights) {
  const std::vector<RunFrame>& frames = record.frames();
  const std::vector<Eigen::Isometry3d> poses = record.metricPoses();
  Json json;
  json["frames"] = frames.size();
  json["tracked_frames"] = record.trackedFrames();
  json["lost_events"] = record.lostEvents();
  json["backfilled_frames"] = std::count_if(frames.begin(), frames.end(),
                                            [](const RunFrame& frame) { return frame.backfilled; });
  json["camera_height_m"] = camera_height;
  json["smoothed"] = record.isSmoothed();
  json["length_m"] = pathLength(poses);
  json["length_sigma_m"] = record.lengthSigma();
  if (record.usedSpeeds() && frames.back().scale.camera_height_sigma > 0) {
    json["learned_camera_height_m"] = frames.back().scale.camera_height;
    json["learned_camera_height_sigma_m"] = frames.back().scale.camera_height_sigma;
  }
  // Without ground truth all are null.
  OdometryMetrics metric, unscaled;
  ScaleMetrics scale;
  CovarianceMetrics covariance;
  const bool has_truth = !ground_truth.empty() && poses.size() >= 2;
  if (has_truth) {
    metric = computeOdometryMetrics(ground_truth, poses);
    unscaled = computeOdometryMetrics(ground_truth, record.unscaledPoses());
    const bool is_exact = !ground_truth_heights.empty();
    covariance = computeCovarianceMetrics(record, ground_truth,
                                          is_exact ? GroundTruthAccuracy{} : kGpsImuAccuracy);
    scale = computeScaleMetrics(record, ground_truth,
                                is_exact ? kExactGroundTruthDistance : kMeasuredGroundTruthDistance,
                                ground_truth_heights);
  }
  addTrajectoryMetrics(metric, unscaled, &json);
  addScaleMetrics(scale, &json);
  addCovarianceMetrics(covariance, &json);
  if (!has_truth) json["gt_length_m"] = json["ate_rmse_m"] = json["covariance_by_length"] = nullptr;
  const std::pair<const char*, double (*)(const RunFrame&)> stages[] = {
      {"ms_vo", voTime}, {"ms_scale", scaleTime}, {"ms_total", totalTime}};
  for (const auto& [name, time] : stages) {
    json[std::string(name) + "_median"] = quantile(timesOf(record, time), 0.5);
    json[std::string(name) + "_p95"] = quantile(timesOf(record, time), 0.95);
  }
  json["peak_rss_mb"] = processUsage().peak_rss_mb;
  roundNumbers(&json);
  return json.dump(2) + "\n";
}

std::string scaleCsv(const RunRecord& record) {
  std::ostringstream stream = csvStream(
      "frame,stamp,status,reason,raw_scale,scale,sigma,height,nx,ny,nz,triangles,"
      "ground_triangles,ground_points,window_points,plane_inliers,backfilled,map_id,vo_status,"
      "source,camera_height,"
      "camera_height_sigma");
  for (std::size_t i = 0; i < record.frames().size(); ++i) {
    const RunFrame& frame = record.frames()[i];
    const ScaleEstimate& s = frame.scale;
    stream << i << ',' << formatSeconds(frame.stamp_ns) << ',' << toString(s.status) << ','
           << toString(s.measurement) << ',' << s.raw_scale << ',' << s.scale << ',' << s.sigma
           << ',' << s.height << ',' << s.n_c.x() << ',' << s.n_c.y() << ',' << s.n_c.z() << ','
           << s.triangles << ',' << s.ground_triangles << ',' << s.ground_points << ','
           << s.window_points << ',' << s.plane_inliers << ',' << frame.backfilled << ','
           << frame.map_id << ',' << toString(frame.vo_status) << ',' << toString(s.source) << ','
           << s.camera_height << ',' << s.camera_height_sigma << '\n';
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
  for (const char* name : {"timing.csv", "ground_truth.txt", "run.json", "report.html", "track.gpx",
                           "track.kml", "track.geojson"}) {  // of an earlier run
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

}  // namespace gsv
