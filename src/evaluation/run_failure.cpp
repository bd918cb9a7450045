#include "ground_scale_vo/evaluation/run_failure.hpp"

#include <algorithm>
#include <map>

#include "common/text.hpp"

namespace gsv {
namespace {

/// Of the frames without a metric pose.
std::string mostFrequentReason(const RunRecord& record) {
  std::map<std::string, std::size_t> counts;
  for (const RunFrame& frame : record.frames()) {
    if (frame.has_metric_pose) continue;
    ++counts[frame.vo_status == VoStatus::kTracking
                 ? std::string("the scale is not known (") + toString(frame.scale.measurement) + ")"
                 : std::string("the odometry is ") + toString(frame.vo_status)];
  }
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == counts.end() ? "there is no image" : most->first;
}

}  // namespace

std::string failureOf(const RunRecord& record) {
  std::size_t metric = 0, moving = 0, held = 0, zoomed = 0;
  for (const RunFrame& frame : record.frames()) {
    if (frame.scale.measurement == MeasurementStatus::kZoomed) ++zoomed;
    if (!frame.has_metric_pose) continue;
    ++metric;
    if (frame.scale.measurement == MeasurementStatus::kStandstill) continue;
    ++moving;
    if (frame.scale.status == ScaleStatus::kHeld) ++held;
  }
  if (metric == 0) return "no metric pose: " + mostFrequentReason(record);
  const std::size_t tracked = record.trackedFrames(), frames = record.frames().size();
  if (2 * tracked < frames) {
    return format(
        "the odometry tracked in only %zu of %zu images: are they in order, and of one drive?",
        tracked, frames);
  }
  if (zoomed > 0) {
    return format(
        "the camera zoomed while driving: no distance is known for %zu of %zu images; fix zoom and "
        "focus",
        zoomed, frames);
  }
  if (2 * held > moving) {
    return format(
        "the scale is held in %zu of %zu images in motion: is the road in front of the camera "
        "visible, and the camera upright?",
        held, moving);
  }
  return {};
}

}  // namespace gsv
