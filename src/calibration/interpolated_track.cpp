#include "interpolated_track.hpp"

#include <algorithm>

namespace ground_scale_vo {
namespace {

/// Minimum share of a segment's moving frames with a measured scale.
constexpr double kMinMeasured = 0.5;

}  // namespace

InterpolatedTrack::InterpolatedTrack(const std::vector<RunFrame>& frames) : frames_(frames) {
  measured_.push_back(0);
  moving_.push_back(0);
  for (const RunFrame& frame : frames) {
    const bool moves = frame.scale.measurement != MeasurementStatus::kStandstill;
    measured_.push_back(measured_.back() + (frame.scale.status == ScaleStatus::kOk ? 1 : 0));
    moving_.push_back(moving_.back() + (moves ? 1 : 0));
  }
}

std::optional<InterpolatedTrack::Position> InterpolatedTrack::at(std::int64_t stamp_ns) const {
  const auto next =
      std::upper_bound(frames_.begin(), frames_.end(), stamp_ns,
                       [](std::int64_t stamp, const RunFrame& f) { return stamp < f.stamp_ns; });
  if (next == frames_.begin()) return {};
  const auto last = next - 1;
  if (!last->has_metric_pose) return {};
  Position position;
  position.frame = static_cast<std::size_t>(last - frames_.begin());
  position.p = last->T_o_c.translation();
  if (last->stamp_ns == stamp_ns) return position;
  if (next == frames_.end() || !next->has_metric_pose || next->map_id != last->map_id) return {};
  const double share = static_cast<double>(stamp_ns - last->stamp_ns) /
                       static_cast<double>(next->stamp_ns - last->stamp_ns);
  position.p += share * (next->T_o_c.translation() - position.p);
  return position;
}

bool InterpolatedTrack::isUnbroken(std::size_t first, std::size_t last) const {
  for (std::size_t i = first; i <= last; ++i) {
    if (!frames_[i].has_metric_pose || frames_[i].map_id != frames_[first].map_id) return false;
  }
  return true;
}

bool InterpolatedTrack::isMeasured(std::size_t first, std::size_t last) const {
  return measured_[last + 1] - measured_[first] >=
         kMinMeasured * (moving_[last + 1] - moving_[first]);
}

}  // namespace ground_scale_vo
