#include "ground_scale_vo/evaluation/run_report.hpp"

#include <algorithm>
#include <cmath>
#include <locale>
#include <optional>
#include <sstream>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/scale_metrics.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

std::ostringstream tableStream() {
  std::ostringstream stream;
  stream.imbue(std::locale::classic());
  stream.precision(10);
  return stream;
}

std::string json(std::optional<double> value) {
  if (!value || !std::isfinite(*value)) return "null";
  std::ostringstream stream = tableStream();
  stream << *value;
  return stream.str();
}

/// An object of one line, or of a line for each member when it is the outermost.
std::string jsonObject(const std::vector<std::pair<std::string, std::string>>& members,
                       const std::string& separator, const std::string& margin) {
  std::string text;
  for (const auto& [key, value] : members) {
    text += (text.empty() ? "" : "," + separator) + "\"" + key + "\": " + value;
  }
  return "{" + margin + text + (margin.empty() ? "}" : "\n}\n");
}

std::string json(const std::vector<OdometryMetrics::LengthError>& errors) {
  std::string text;
  for (const auto& error : errors) {
    text +=
        (text.empty() ? "" : ", ") + jsonObject({{"length_m", json(error.length_m)},
                                                 {"segments", json(error.segments)},
                                                 {"t_err_percent", json(error.t_err_percent)},
                                                 {"r_err_deg_per_m", json(error.r_err_deg_per_m)}},
                                                " ", "");
  }
  return "[" + text + "]";
}

double voTime(const RunFrame& frame) { return frame.vo_times.total; }
double scaleTime(const RunFrame& frame) { return frame.scale_times.total; }
double totalTime(const RunFrame& frame) { return voTime(frame) + scaleTime(frame); }

std::vector<double> timesOf(const RunRecord& record, double (*time)(const RunFrame&)) {
  std::vector<double> times;
  for (const RunFrame& frame : record.frames()) times.push_back(time(frame));
  return times;
}

}  // namespace

std::string metricsJson(const RunRecord& record, double camera_height,
                        const std::vector<Eigen::Isometry3d>& ground_truth,
                        const std::vector<double>& true_heights) {
  const auto& frames = record.frames();
  const auto metric_poses = record.metricPoses();
  std::optional<OdometryMetrics> metrics, unscaled;
  std::optional<ScaleMetrics> scale;
  if (!ground_truth.empty() && frames.size() >= 2) {
    metrics = computeOdometryMetrics(ground_truth, metric_poses);
    unscaled = computeOdometryMetrics(ground_truth, record.unscaledPoses());
    scale = computeScaleMetrics(record, ground_truth,
                                true_heights.empty() ? kWayOfMeasuredTruth : kWayOfExactTruth,
                                true_heights);
  }
  const auto ofTruth = [&](auto member) {
    return metrics ? json((*metrics).*member) : std::string("null");
  };
  const auto ofScale = [&](auto member) {
    return scale ? json((*scale).*member) : std::string("null");
  };
  using Metrics = OdometryMetrics;
  const auto backfilled = std::count_if(frames.begin(), frames.end(),
                                        [](const RunFrame& frame) { return frame.backfilled; });
  std::vector<std::pair<std::string, std::string>> members{
      {"frames", std::to_string(frames.size())},
      {"tracked_frames", std::to_string(record.trackedFrames())},
      {"lost_events", std::to_string(record.lostEvents())},
      {"backfilled_frames", std::to_string(backfilled)},
      {"camera_height_m", json(camera_height)},
      {"length_m", json(pathLength(metric_poses))},
      {"gt_length_m", ofTruth(&Metrics::gt_length_m)},
      {"rle_percent", ofTruth(&Metrics::rle_percent)},
      {"t_err_percent", ofTruth(&Metrics::t_err_percent)},
      {"r_err_deg_per_m", ofTruth(&Metrics::r_err_deg_per_m)},
      {"t_err_short_percent", ofTruth(&Metrics::t_err_short_percent)},
      {"t_err_true_length_percent", ofTruth(&Metrics::t_err_true_length_percent)},
      {"t_err_sim3_percent", unscaled ? json(unscaled->t_err_sim3_percent) : "null"},
      {"direction_median_deg", ofTruth(&Metrics::direction_median_deg)},
      {"ate_rmse_m", ofTruth(&Metrics::ate_rmse_m)},
      {"scale_within_2_sigma", ofScale(&ScaleMetrics::within_2_sigma)},
      {"scale_held_share", ofScale(&ScaleMetrics::held_share)},
      {"scale_error_median_percent", ofScale(&ScaleMetrics::error_median_percent)},
      {"scale_error_spread_percent", ofScale(&ScaleMetrics::error_spread_percent)},
      {"height_bias_percent", ofScale(&ScaleMetrics::height_bias_percent)}};
  const std::pair<const char*, double (*)(const RunFrame&)> stages[] = {
      {"ms_vo", voTime}, {"ms_scale", scaleTime}, {"ms_total", totalTime}};
  for (const auto& [name, time] : stages) {
    const std::vector<double> times = timesOf(record, time);
    members.emplace_back(std::string(name) + "_median", json(quantile(times, 0.5)));
    members.emplace_back(std::string(name) + "_p95", json(quantile(times, 0.95)));
  }
  members.emplace_back("peak_rss_mb", json(processUsage().peak_rss_mb));
  members.emplace_back("by_length", metrics ? json(metrics->by_length) : "null");
  members.emplace_back("by_short_length", metrics ? json(metrics->by_short_length) : "null");
  return jsonObject(members, "\n  ", "\n  ");
}

std::string scaleCsv(const RunRecord& record) {
  std::ostringstream stream = tableStream();
  stream << "frame,stamp,status,reason,raw_scale,scale,sigma,height,nx,ny,nz,triangles,"
            "ground_triangles,ground_points,window_points,plane_inliers,backfilled,map_id,"
            "vo_status\n";
  for (std::size_t i = 0; i < record.frames().size(); ++i) {
    const RunFrame& frame = record.frames()[i];
    const ScaleEstimate& s = frame.scale;
    stream << i << ',' << formatSeconds(frame.stamp_ns) << ',' << toString(s.status) << ','
           << toString(s.reason) << ',' << s.raw_scale << ',' << s.scale << ',' << s.sigma << ','
           << s.height << ',' << s.n_c.x() << ',' << s.n_c.y() << ',' << s.n_c.z() << ','
           << s.triangles << ',' << s.ground_triangles << ',' << s.ground_points << ','
           << s.window_points << ',' << s.plane_inliers << ',' << frame.backfilled << ','
           << frame.map_id << ',' << toString(frame.vo_status) << '\n';
  }
  return stream.str();
}

std::string timingCsv(const RunRecord& record) {
  std::ostringstream stream = tableStream();
  stream << "frame,decode,vo_pyramid,vo_track,vo_adjustment_wait,vo_align,vo_pose,vo_detect,"
            "vo_triangulate,vo_bundle_adjustment,vo_total,scale_delaunay,scale_gpe,scale_gpa,scale_"
            "refine,scale_filter,scale_total,"
            "total\n";
  for (std::size_t i = 0; i < record.frames().size(); ++i) {
    const RunFrame& frame = record.frames()[i];
    const VisualOdometry::Times& vo = frame.vo_times;
    const ScaleRecovery::Times& scale = frame.scale_times;
    stream << i << ',' << frame.decode_ms << ',' << vo.pyramid << ',' << vo.track << ','
           << vo.adjustment_wait << ',' << vo.align << ',' << vo.pose << ',' << vo.detect << ','
           << vo.triangulate << ',' << vo.bundle_adjustment << ',' << vo.total << ','
           << scale.delaunay << ',' << scale.gpe << ',' << scale.gpa << ',' << scale.refine << ','
           << scale.filter << ',' << scale.total << ',' << totalTime(frame) << '\n';
  }
  return stream.str();
}

void writeRun(const fs::path& folder, const RunRecord& record, double camera_height,
              const std::vector<Eigen::Isometry3d>& ground_truth,
              const std::vector<double>& true_heights) {
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
  const std::vector<double> times = timesOf(record, totalTime);
  if (std::any_of(times.begin(), times.end(), [](double ms) { return std::isfinite(ms); })) {
    writeFile(folder / "timing.csv", timingCsv(record));
  }
  writeFile(folder / "metrics.json",
            metricsJson(record, camera_height, ground_truth, true_heights));
  if (!ground_truth.empty()) writeKittiPoses(folder / "ground_truth.txt", ground_truth);
}

}  // namespace ground_scale_vo
