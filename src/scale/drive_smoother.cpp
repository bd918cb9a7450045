#include "scale/drive_smoother.hpp"

#include <algorithm>
#include <utility>

#include "scale/metric_trajectory.hpp"

namespace gsv {

void DriveSmoother::addStep(const ScaleFilter& filter) {
  if (starts_map_) map_starts_.push_back(steps_.size());
  const auto map_begin = steps_.begin() + static_cast<std::ptrdiff_t>(map_starts_.back());
  if (const auto& since = filter.wrongSince()) {
    auto first = std::lower_bound(
        map_begin, steps_.end(), *since,
        [](const Step& step, double distance) { return step.distance < distance; });
    const bool starts_chain = first != steps_.end();
    for (auto step = first; step != steps_.end(); ++step) {
      step->starts_chain = step == first;
      step->has_height = step->has_scale = false;
    }
    starts_map_ = starts_map_ || !starts_chain;
  }
  steps_.push_back({filter.predicted(), filter.state(), filter.distance(), filter.nisScale(),
                    filter.heightKnown(), filter.known(), std::exchange(starts_map_, false)});
}

void DriveSmoother::addFrame(const VoFrame& frame, Continuity continuity,
                             const ScaleEstimate& scale, const SpeedTrack& speeds) {
  Frame record{{},
               continuity,
               scale,
               std::exchange(new_speeds_, {}),
               speeds.agrees(),
               speeds.zeroIsStop(),
               steps_.size(),
               map_starts_.size()};
  record.vo.stamp_ns = frame.stamp_ns;
  record.vo.status = frame.status;
  record.vo.continuity = frame.continuity;
  record.vo.T_w_c = frame.T_w_c;
  record.vo.pose_covariance = frame.pose_covariance;
  record.vo.map_start = frame.map_start;
  frames_.push_back(std::move(record));
}

/// The chains from their ends to their starts. Where the height was not known yet, or wrong, it is
/// that of the step after.
std::vector<DriveSmoother::Step> DriveSmoother::smoothedSteps() const {
  std::vector<Step> smoothed = steps_;
  for (std::size_t i = steps_.size(); i-- > 0;) {
    if (i + 1 == steps_.size()) continue;
    Step& step = smoothed[i];
    const Step& next = smoothed[i + 1];
    const Step& predicted = steps_[i + 1];
    if (predicted.starts_chain) {
      HeightState constants = predicted.predicted;
      constants.startMap();  // only they continue
      step.filtered = step.filtered.smoothed(constants, next.filtered);
    } else if (step.has_height) {
      step.filtered = step.filtered.smoothed(predicted.predicted, next.filtered);
    } else {
      step.filtered = next.filtered;
    }
    if (!predicted.starts_chain) {
      step.has_height = step.has_height || next.has_height;
      step.has_scale = step.has_scale || next.has_scale;
    }
  }
  return smoothed;
}

std::vector<DriveSmoother::Smoothed> DriveSmoother::smoothed(
    const ScaleRecoveryOptions& options) const {
  const std::vector<Step> steps = smoothedSteps();
  MetricTrajectoryOptions trajectory_options = options.trajectory;
  trajectory_options.young_map_heights = 0;  // the first scale is as good as a later one
  MetricTrajectory trajectory(trajectory_options);
  SpeedTrack speeds(options.speed_sigma);
  std::vector<Smoothed> result;
  for (const Frame& frame : frames_) {
    for (const SpeedSample& speed : frame.speeds) speeds.add(speed);
    speeds.setAgrees(frame.speeds_agree);
    if (!frame.zero_is_stop) speeds.ignoreZero();
    ScaleEstimate scale = frame.scale;
    scale.status = ScaleStatus::kUnknown;
    scale.scale = scale.sigma = scale.height = 0;
    // At a standstill, and before the first step of a map, the nearest one.
    const std::size_t i = frame.steps == 0 ? 0 : frame.steps - 1;
    if (i < steps.size()) {
      const HeightState& state = steps[i].filtered;
      if (state.hasCameraHeight()) {
        scale.camera_height = state.cameraHeight();
        scale.camera_height_sigma = state.cameraHeightSigma();
      }
      if (steps[i].has_scale || (steps[i].has_height && state.hasCameraHeight())) {
        scale.status =
            frame.scale.status == ScaleStatus::kOk ? ScaleStatus::kOk : ScaleStatus::kHeld;
        if (steps[i].has_height) scale.height = state.height();
        scale.scale = state.cameraHeight() / state.height();
        scale.sigma = scale.scale * state.scaleSigma(steps[i].nis_scale);
      }
    }
    result.push_back({scale, trajectory.append(frame.vo, frame.continuity, scale, speeds)});
  }
  return result;
}

}  // namespace gsv
