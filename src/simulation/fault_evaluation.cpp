#include "ground_scale_vo/simulation/fault_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/evaluation/odometry_metrics.hpp"

namespace ground_scale_vo {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;

/// Data of a run for its evaluation, one entry per frame.
struct FaultDriveRun {
  Poses ground_truth, estimate;           // T_c0_c: camera in the first camera's frame [m]
  std::vector<double> true_path, path;    // path length up to the frame [m]
  std::vector<double> position_variance;  // trace, as last reported [m^2]
  std::vector<RunFrame> frames;
  double frame_rate_hz = 0;

  bool isMeasured(std::size_t i) const { return frames[i].scale.status == ScaleStatus::kOk; }

  /// The first frame after `from` by which the odometry has settled, or the last frame.
  std::size_t settledAfter(std::size_t from) const {
    std::size_t i = from;
    while (i + 1 < frames.size() &&
           (static_cast<double>(i - from) < kSettlingTime * frame_rate_hz ||
            true_path[i] - true_path[from] < kSettlingDistance)) {
      ++i;
    }
    return i;
  }

  /// Error of the position of frame b relative to frame a [m].
  double relativePositionError(std::size_t a, std::size_t b) const {
    const Eigen::Isometry3d T_true = ground_truth[a].inverse() * ground_truth[b];
    const Eigen::Isometry3d T_estimated = estimate[a].inverse() * estimate[b];
    return (T_true.translation() - T_estimated.translation()).norm();
  }
};

/// Response from the first faulty frame on. `after`: first frame of the next segment.
FaultMetrics evaluateFault(const FaultDriveRun& run, const PlacedFault& fault, std::size_t after) {
  FaultMetrics m;
  m.name = fault.name;
  m.hides_ground = fault.hides_ground;
  m.duration_s = static_cast<double>(fault.last - fault.first + 1) / run.frame_rate_hz;
  m.detection_delay_s = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = fault.first; i <= fault.last; ++i) {
    const double since = static_cast<double>(i - fault.first) / run.frame_rate_hz;
    const bool is_detected = run.frames[i].vo_status == VoStatus::kLost ||
                             run.frames[i].scale.status == ScaleStatus::kHeld;
    if (is_detected && std::isnan(m.detection_delay_s)) m.detection_delay_s = since;
    m.ok_frames += since >= kMaxDetectionDelay && run.isMeasured(i);
  }
  m.tracking_recovery_frames = m.metric_recovery_frames = -1;
  for (std::size_t i = run.frames.size() - 1; i > fault.last; --i) {
    const auto delay = static_cast<int>(i - fault.last - 1);
    if (run.frames[i].vo_status == VoStatus::kTracking) m.tracking_recovery_frames = delay;
    if (run.isMeasured(i) && run.frames[i].has_metric_pose) m.metric_recovery_frames = delay;
  }
  const std::size_t before = fault.first - 1;
  const double true_length = run.true_path[after] - run.true_path[before];
  m.excess_path_m = std::max(0.0, run.path[after] - run.path[before] - true_length);
  m.position_error_m = run.relativePositionError(before, after);
  m.sigma_m =
      std::sqrt(std::max(0.0, run.position_variance[after] - run.position_variance[before]));
  return m;
}

/// Adds the faults and the segments between them.
void evaluate(const FaultDriveRun& run, const std::vector<PlacedFault>& faults,
              FaultDriveMetrics* metrics) {
  std::size_t segment_first = run.settledAfter(0);
  const auto addSegment = [&](std::size_t last) {
    const double length = run.true_path[last] - run.true_path[segment_first];
    if (last <= segment_first || length < kMinSegmentLength) return;
    const double error = run.relativePositionError(segment_first, last);
    metrics->segments.push_back({segment_first, last, length, 100 * error / length});
  };
  for (const PlacedFault& fault : faults) {
    addSegment(fault.first - 1);
    segment_first = run.settledAfter(fault.last + 1);
    metrics->faults.push_back(evaluateFault(run, fault, segment_first));
  }
  addSegment(run.frames.size() - 1);
}

}  // namespace

bool isFinite(const VisualOdometry::Output& vo) {
  bool all = areFinite(vo.frame.T_w_c, vo.frame.map_start.R_previous_w);
  for (const TrackedFeature& feature : vo.frame.features) {
    all = all && isFinite(feature.u);
    if (feature.has_point) all = all && areFinite(feature.p_c, feature.depth_sigma);
  }
  for (const auto& start : vo.start) all = all && isFinite(start.T_w_c);
  for (const auto& rejected : vo.rejected) all = all && isFinite(rejected.u);
  return all;
}

bool isFinite(const ScaleRecovery::Output& output) {
  const ScaleEstimate& s = output.scale;
  bool all = areFinite(s.raw_scale, s.scale, s.sigma, s.height, s.n_c, output.plane.n_c,
                       output.plane.height, output.correlation, output.mounting_pitch,
                       output.mounting_roll, output.mounting_sigma);
  for (const auto& m : {output.feature_based, output.direct}) {
    all = all && areFinite(m.height, m.sigma, m.road_distance);
  }
  for (const Eigen::Vector3f& point : output.ground_points_c) all = all && isFinite(point);
  if (!output.pose) return all;
  const MetricPose& pose = *output.pose;
  return all &&
         areFinite(pose.T_o_c, pose.covariance, pose.twist_c, pose.twist_covariance,
                   pose.distance) &&
         pose.covariance.diagonal().minCoeff() >= 0 &&
         pose.twist_covariance.diagonal().minCoeff() >= 0;
}

FaultDriveMetrics runFaultDrive(
    const FaultDrive& fault_drive,
    const std::function<void(std::size_t, const cv::Mat&, const OfflineRun&)>& each) {
  const SyntheticDrive drive(fault_drive.options);
  OfflineRun::Options options;
  options.scale.camera_height = drive.cameraHeight();
  OfflineRun offline(drive.camera(), options);

  FaultDriveMetrics metrics;
  metrics.frames = drive.size();
  FaultDriveRun run;
  run.frame_rate_hz = fault_drive.options.frame_rate_hz;
  cv::Mat last_good;
  auto fault = fault_drive.faults.begin();
  for (std::size_t i = 0; i < drive.size(); ++i) {
    while (fault != fault_drive.faults.end() && i > fault->last) ++fault;
    const bool is_faulty = fault != fault_drive.faults.end() && fault->image && i >= fault->first;
    cv::Mat image = is_faulty && !needsScene(*fault->image) ? cv::Mat() : drive.image(i);
    if (is_faulty) {
      image = injectFault(*fault->image, image, last_good, i - fault->first, fault->seed);
    } else {
      last_good = image;
    }
    offline.process(image, drive.frame(i).stamp_ns);
    const ScaleRecovery::Output& scale = offline.last().scale;
    metrics.non_finite_frames += !isFinite(offline.last().vo) || !isFinite(scale);
    run.ground_truth.push_back(drive.frame(i).T_c0_c);
    const double previous = run.position_variance.empty() ? 0 : run.position_variance.back();
    run.position_variance.push_back(
        scale.pose ? scale.pose->covariance.topLeftCorner<3, 3>().trace() : previous);
    if (each) each(i, image, offline);
  }
  metrics.tracked_frames = offline.record().trackedFrames();
  run.frames = offline.record().frames();
  run.estimate = offline.record().metricPoses();
  run.true_path = distancesTravelled(run.ground_truth);
  run.path = distancesTravelled(run.estimate);
  evaluate(run, fault_drive.faults, &metrics);
  return metrics;
}

std::string violatedThreshold(const FaultDriveMetrics& metrics) {
  char text[200];
  const auto format = [&](auto... values) {
    std::snprintf(text, sizeof text, values...);
    return std::string(text);
  };
  if (metrics.non_finite_frames > 0) {
    return format("%zu frames contain a number that is not finite", metrics.non_finite_frames);
  }
  if (metrics.segments.empty()) return "no fault-free segment is long enough";
  for (const FaultFreeSegment& s : metrics.segments) {
    if (s.error_percent <= kMaxSegmentErrorPercent) continue;  // false for NaN
    return format(
        "fault-free frames %zu to %zu: position error %.1f %% of the path length, limit %.0f %%",
        s.first, s.last, s.error_percent, kMaxSegmentErrorPercent);
  }
  for (const FaultMetrics& f : metrics.faults) {
    const char* name = f.name.c_str();
    if (f.hides_ground && !(f.detection_delay_s <= kMaxDetectionDelay)) {
      return format("%s: neither HELD nor LOST within %.0f s", name, kMaxDetectionDelay);
    }
    if (f.hides_ground && f.ok_frames > 0) {
      return format(
          "%s: scale reported as measured in %zu frames more than %.0f s after the ground was "
          "hidden",
          name, f.ok_frames, kMaxDetectionDelay);
    }
    if (f.metric_recovery_frames < 0) {
      return format("%s: no metric pose with a measured scale (OK) afterwards", name);
    }
    if (f.excess_path_m > kPositionTolerance + kPathLengthTolerance * f.position_error_m) {
      return format("%s: path %.1f m longer than the ground truth", name, f.excess_path_m);
    }
    if (f.position_error_m > kPositionTolerance + kMaxErrorSigmas * f.sigma_m) {
      return format("%s: position error of %.1f m, sigma is %.1f m", name, f.position_error_m,
                    f.sigma_m);
    }
  }
  return "";
}

}  // namespace ground_scale_vo
