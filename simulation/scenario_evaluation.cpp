#include "simulation/scenario_evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"

namespace gsv {
namespace {

/// Angle of the error of the rotation from the first to the last frame [deg].
double rotationError(const SyntheticDrive& drive, const std::vector<RunFrame>& frames) {
  const auto last = frames.size() - 1;
  const Eigen::Matrix3d estimate =
      frames.front().T_o_c.linear().transpose() * frames.back().T_o_c.linear();
  return Eigen::AngleAxisd(drive.frame(last).T_c0_c.linear().transpose() * estimate).angle() *
         kDegreesPerRadian;
}

/// Normalised error of the displacement from the first metric pose to the last frame.
double displacementSigmas(const RunRecord& record,
                          const std::vector<Eigen::Isometry3d>& ground_truth) {
  const std::vector<RunFrame>& frames = record.frames();
  const auto first = std::find_if(frames.begin(), frames.end(),
                                  [](const RunFrame& frame) { return frame.has_metric_pose; });
  if (first == frames.end() || !frames.back().has_metric_pose || first + 1 == frames.end()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const RelativePoseError relative = relativePoseError(
      record, ground_truth, static_cast<std::size_t>(first - frames.begin()), frames.size() - 1);
  const Eigen::Vector3d along =
      (frames.back().T_o_c.translation() - first->T_o_c.translation()).normalized();
  return std::abs(along.dot(relative.error.head<3>())) /
         std::sqrt(along.dot(relative.covariance.topLeftCorner<3, 3>() * along));
}

/// Sets the metrics of the reaction to the fault.
void evaluateFault(const FrameRange& fault, const SyntheticDrive& drive, const RunRecord& record,
                   const std::vector<Eigen::Isometry3d>& ground_truth, ScenarioMetrics* metrics) {
  constexpr double kSettlingTime = 3, kSettlingDistance = 20;  // [s, m]
  const std::vector<RunFrame>& frames = record.frames();
  const std::size_t last = frames.size() - 1;
  metrics->recovery_frames = -1;
  for (std::size_t i = last; i > fault.last; --i) {
    if (frames[i].scale.status == ScaleStatus::kOk && frames[i].has_metric_pose) {
      metrics->recovery_frames = static_cast<int>(i - fault.last - 1);
    }
  }
  const std::vector<double> path = distancesTravelled(ground_truth);
  std::size_t settled = fault.last;
  const auto elapsed = [&] {
    return static_cast<double>(drive.frame(settled).stamp_ns - drive.frame(fault.last).stamp_ns) *
           1e-9;
  };
  while (settled < last &&
         (elapsed() < kSettlingTime || path[settled] - path[fault.last] < kSettlingDistance)) {
    ++settled;
  }
  if (settled == last) return;
  const Eigen::Isometry3d T_true = ground_truth[settled].inverse() * ground_truth[last];
  const Eigen::Isometry3d T_estimated = frames[settled].T_o_c.inverse() * frames[last].T_o_c;
  metrics->error_after_fault_percent = 100 *
                                       (T_true.translation() - T_estimated.translation()).norm() /
                                       (path[last] - path[settled]);
}

}  // namespace

std::vector<cv::Mat> renderDrive(const SyntheticDrive& drive) {
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < drive.size(); ++i) images.push_back(drive.image(i));
  return images;
}

RunRecord runDrive(const SyntheticDrive& drive, const std::vector<cv::Mat>& images,
                   const std::vector<std::string>& settings, const KnownLengths& known,
                   const cv::Mat& mask) {
  OfflineRun::Options options;
  options.scale.camera_height = known.camera_height ? drive.cameraHeight() : 0;
  options.scale.camera_height_sigma = 0;  // the height is exact
  options.scale.use_speed = !known.speeds.empty();
  for (const std::string& setting : settings) setOption(options, setting);
  OfflineRun run(drive.camera(), options, mask);
  run.setSpeeds(known.speeds);
  for (std::size_t i = 0; i < images.size(); ++i) {
    run.process(images[i], drive.frame(i).stamp_ns);
  }
  return run.record();
}

std::string violatedThreshold(const ScenarioMetrics& metrics,
                              const ScenarioThresholds& thresholds) {
  if (metrics.tracked_frames + thresholds.max_untracked_frames < metrics.frames ||
      (metrics.lost_events > 0 && thresholds.max_untracked_frames == 0)) {
    return "lost";
  }
  const auto frames = static_cast<double>(metrics.frames);
  if (!(static_cast<double>(metrics.metric_frames) > thresholds.min_metric_share * frames))
    return "late scale";
  if (!(metrics.rotation_error_deg <= thresholds.max_rotation_error_deg)) return "rotation";
  if (!(metrics.rle_percent <= thresholds.max_rle_percent) &&
      !(metrics.displacement_sigmas <= thresholds.max_displacement_sigmas)) {
    return "RLE";
  }
  if (!(metrics.within_2_sigma >= thresholds.min_within_2_sigma)) return "2 sigma";
  if (!(metrics.ok_while_unobservable <= thresholds.max_ok_while_unobservable)) {
    return "ok while unobservable";
  }
  if (metrics.recovery_frames < 0) return "no recovery";
  return metrics.error_after_fault_percent <= thresholds.max_error_after_fault_percent
             ? ""
             : "error after the fault";
}

ScenarioMetrics evaluateScenario(const Scenario& scenario, const SyntheticDrive& drive,
                                 const RunRecord& record) {
  const std::vector<RunFrame>& frames = record.frames();
  if (frames.size() != drive.size()) {
    throw OptionError("the run has " + std::to_string(frames.size()) + " frames, the drive " +
                      std::to_string(drive.size()));
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  ScenarioMetrics metrics;
  metrics.frames = frames.size();
  metrics.tracked_frames = record.trackedFrames();
  metrics.lost_events = record.lostEvents();
  metrics.rle_percent = metrics.t_err_short_percent = kNone;

  const std::vector<Eigen::Isometry3d> full_ground_truth = groundTruth(drive);
  std::vector<Eigen::Isometry3d> ground_truth, estimate;  // from the first metric pose on
  std::size_t ok_frames = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const RunFrame& frame = frames[i];
    ok_frames += scenario.unobservable.contains(i) && frame.scale.status == ScaleStatus::kOk;
    if (ground_truth.empty() && !frame.has_metric_pose) continue;
    ground_truth.push_back(full_ground_truth[i]);
    estimate.push_back(frame.T_o_c);
  }
  metrics.rotation_error_deg = rotationError(drive, frames);
  metrics.displacement_sigmas = displacementSigmas(record, full_ground_truth);
  metrics.metric_frames = ground_truth.size();
  if (ground_truth.size() > 1) {
    const OdometryMetrics odometry = computeOdometryMetrics(ground_truth, estimate);
    metrics.rle_percent = odometry.rle_percent.value_or(kNone);
    metrics.t_err_short_percent = odometry.t_err_short_percent.value_or(kNone);
  }
  const ScaleMetrics scale =
      computeScaleMetrics(record, full_ground_truth, kExactGroundTruthDistance);
  metrics.scale_error_percent = scale.error_abs_median_percent;
  metrics.within_2_sigma = scale.within_2_sigma;
  metrics.held_share = scale.held_share;
  if (!scenario.unobservable.isEmpty()) {
    metrics.ok_while_unobservable =
        static_cast<double>(ok_frames) /
        static_cast<double>(scenario.unobservable.last - scenario.unobservable.first + 1);
  }
  if (!scenario.fault.isEmpty()) {
    evaluateFault(scenario.fault, drive, record, full_ground_truth, &metrics);
  }
  return metrics;
}

}  // namespace gsv
