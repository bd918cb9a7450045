#include "fault_tables.hpp"

#include <algorithm>

#include "ground_scale_vo/common/text.hpp"

namespace ground_scale_vo {

std::vector<FaultDrive> selectFaultDrives(const std::vector<std::string>& names,
                                          std::uint64_t seed) {
  std::vector<FaultDrive> drives;
  for (const std::string& name : names) drives.push_back(faultDrive(name, seed));
  for (std::size_t i = 0; names.empty() && i < kFaultDriveCount; ++i) {
    drives.push_back(faultDrive(i, seed));
  }
  return drives;
}

std::string faultDriveText(const FaultDrive& drive, const FaultDriveMetrics& metrics) {
  const SyntheticDrive::Options& o = drive.options;
  std::string text = format(
      "%s: %zu frames at %.0f Hz, %dx%d, camera %.2f m high, %.1f m/s; %zu tracked, %zu not "
      "finite\n",
      drive.name.c_str(), metrics.frames, o.frame_rate_hz, o.camera.width, o.camera.height,
      o.camera_height, o.speed, metrics.tracked_frames, metrics.non_finite_frames);
  for (const FaultFreeSegment& s : metrics.segments) {
    text += format("  frames %3zu to %3zu: %5.1f m, error %.2f %%\n", s.first, s.last, s.length_m,
                   s.error_percent);
  }
  for (std::size_t i = 0; i < metrics.faults.size(); ++i) {
    const FaultMetrics& f = metrics.faults[i];
    text += format(
        "  frames %3zu to %3zu: %-13s %4.1f s%s: detected %.1f s, ok %zu, tracking %d, "
        "metric %d, excess path %.2f m, error %.1f m, sigma %.1f m\n",
        drive.faults[i].first, drive.faults[i].last, f.name.c_str(), f.duration_s,
        f.hides_ground ? ", hides" : "", f.detection_delay_s, f.ok_frames,
        f.tracking_recovery_frames, f.metric_recovery_frames, f.excess_path_m, f.position_error_m,
        f.sigma_m);
  }
  const std::string violated = violatedThreshold(metrics);
  if (!violated.empty()) text += "  VIOLATED: " + violated + "\n";
  return text;
}

FaultSummary summarise(const std::vector<FaultDriveMetrics>& drives) {
  const auto violations = std::count_if(
      drives.begin(), drives.end(),
      [](const FaultDriveMetrics& metrics) { return !violatedThreshold(metrics).empty(); });
  return {format("%zu drives, %td with a violated threshold\n", drives.size(), violations),
          violations > 0 ? 1 : 0};
}

}  // namespace ground_scale_vo
