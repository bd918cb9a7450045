#include "ground_scale_vo/evaluation/run_record.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace gsv {

void RunRecord::append(const VisualOdometry::Output& vo, const ScaleRecovery::Output& scale,
                       double decode_ms) {
  if (vo.frame.sequence != frame_of_.size()) {
    throw std::logic_error("the odometry's frame numbers do not follow the images");
  }
  RunFrame frame;
  frame.stamp_ns = vo.frame.stamp_ns;
  frame.vo_status = vo.frame.status;
  frame.map_id = vo.frame.map_id;
  frame.has_vo_pose = vo.frame.status == VoStatus::kTracking;
  if (frame.has_vo_pose) frame.T_w_c = vo.frame.T_w_c;
  frame.speed_error = scale.speed_error;
  frame.speed_warning = scale.speed_warning;
  frame.decode_ms = decode_ms;
  frame.vo_times = vo.times;
  frame.scale_times = scale.times;
  frame_of_.push_back(frames_.size());
  frames_.push_back(frame);

  for (const StampedPose& start : vo.start) {
    const auto index = std::lower_bound(
        frame_of_.begin(), frame_of_.end(), start.stamp_ns,
        [&](std::size_t i, std::int64_t stamp_ns) { return frames_[i].stamp_ns < stamp_ns; });
    RunFrame& earlier = frames_.at(*index);
    if (earlier.has_vo_pose) continue;
    earlier.has_vo_pose = true;
    earlier.map_id = vo.frame.map_id;
    earlier.T_w_c = start.T_w_c;
  }

  setMetric(frames_.size() - 1, scale.scale, scale.pose);
}

/// Precondition: the frames before it have theirs.
void RunRecord::setMetric(std::size_t index, const ScaleEstimate& scale,
                          const std::optional<MetricPose>& pose) {
  RunFrame& frame = frames_[index];
  frame.scale = scale;
  frame.backfilled = false;
  frame.has_metric_pose = pose.has_value();
  frame.T_o_c = pose        ? pose->T_o_c
                : index > 0 ? frames_[index - 1].T_o_c
                            : Eigen::Isometry3d::Identity();
  if (!pose) return;
  frame.covariance = pose->covariance;
  frame.distance_sigma = pose->distance_sigma;
  if (!has_metric_pose_) fillBackwards(index);
  has_metric_pose_ = true;
}

void RunRecord::smooth(const std::vector<ScaleRecovery::Smoothed>& smoothed) {
  is_smoothed_ = true;
  has_metric_pose_ = false;
  std::size_t used = 0;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (used < frame_of_.size() && frame_of_[used] == i) {
      setMetric(i, smoothed.at(used).scale, smoothed.at(used).pose);
      ++used;
    } else {
      holdMetric(i);
    }
  }
}

void RunRecord::appendUnused(std::int64_t stamp_ns) {
  constexpr double kNotKnown = std::numeric_limits<double>::quiet_NaN();
  RunFrame frame;
  frame.stamp_ns = stamp_ns;
  frame.vo_times.total = frame.scale_times.total = kNotKnown;
  if (!frames_.empty()) {
    frame.vo_status = frames_.back().vo_status;
    frame.map_id = frames_.back().map_id;
    frame.speed_error = frames_.back().speed_error;
  }
  frames_.push_back(frame);
  holdMetric(frames_.size() - 1);
}

void RunRecord::holdMetric(std::size_t index) {
  if (index == 0) return;
  ScaleEstimate scale = frames_[index - 1].scale;
  if (scale.status == ScaleStatus::kOk) scale.status = ScaleStatus::kHeld;
  setMetric(index, scale, std::nullopt);
}

/// index: of the first frame with a metric pose.
void RunRecord::fillBackwards(std::size_t index) {
  const Eigen::Isometry3d T_o_c = frames_[index].T_o_c;
  const std::uint32_t map_id = frames_[index].map_id;
  const auto metric = [scale = frames_[index].scale.scale](Eigen::Isometry3d T_w_c) {
    T_w_c.translation() *= scale;
    return T_w_c;
  };
  const Eigen::Isometry3d T_o_w = T_o_c * metric(frames_[index].T_w_c).inverse();
  Eigen::Isometry3d last = Eigen::Isometry3d::Identity();
  for (std::size_t i = 0; i < index; ++i) {
    RunFrame& frame = frames_[i];
    if (frame.has_vo_pose && frame.map_id == map_id) {
      last = T_o_w * metric(frame.T_w_c);
    }
    frame.T_o_c = last;
    frame.backfilled = true;
  }
}

std::size_t RunRecord::trackedFrames() const {
  return static_cast<std::size_t>(std::count_if(
      frames_.begin(), frames_.end(), [](const RunFrame& frame) { return frame.has_vo_pose; }));
}

bool RunRecord::usedSpeeds() const {
  return std::any_of(frames_.begin(), frames_.end(), [](const RunFrame& frame) {
    return frame.scale.source == ScaleSource::kSpeed || frame.scale.source == ScaleSource::kBoth;
  });
}

std::size_t RunRecord::lostEvents() const {
  std::size_t events = 0;
  for (std::size_t i = 1; i < frames_.size(); ++i) {
    events += frames_[i - 1].vo_status == VoStatus::kTracking &&
              frames_[i].vo_status != VoStatus::kTracking;
  }
  return events;
}

std::vector<Eigen::Isometry3d> RunRecord::metricPoses() const {
  std::vector<Eigen::Isometry3d> poses;
  for (const RunFrame& frame : frames_) poses.push_back(frame.T_o_c);
  return poses;
}

double RunRecord::lengthSigma() const {
  const auto last = std::find_if(frames_.rbegin(), frames_.rend(),
                                 [](const RunFrame& frame) { return frame.has_metric_pose; });
  return last == frames_.rend() ? std::numeric_limits<double>::quiet_NaN() : last->distance_sigma;
}

std::vector<Eigen::Isometry3d> RunRecord::unscaledPoses() const {
  std::vector<Eigen::Isometry3d> poses;
  const RunFrame* last_posed = nullptr;
  Eigen::Isometry3d last = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_first_w = Eigen::Isometry3d::Identity();  // of the current map
  for (const RunFrame& frame : frames_) {
    if (frame.has_vo_pose) {
      const bool new_map = last_posed != nullptr && last_posed->map_id != frame.map_id;
      if (new_map) T_first_w = last * frame.T_w_c.inverse();
      last = T_first_w * frame.T_w_c;
      last_posed = &frame;
    }
    poses.push_back(last);
  }
  return poses;
}

}  // namespace gsv
