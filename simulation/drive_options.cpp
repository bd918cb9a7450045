#include <algorithm>
#include <cmath>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "simulation/synthetic_drive.hpp"
#include "simulation/world/motion.hpp"
#include "simulation/world/road_geometry.hpp"

namespace ground_scale_vo {

using simulation::kMaxDriveLength;
using simulation::kRoadBehind;

SyntheticDrive::Options::Options() {
  camera.width = 800;
  camera.height = 248;
  camera.fx = camera.fy = 464;
  camera.cx = 394;
  camera.cy = 121;
}

void SyntheticDrive::Options::validate() const {
  camera.validate();
  requireInRange("camera.width", camera.width, 16, 8192);
  requireInRange("camera.height", camera.height, 16, 8192);
  requireInRange("camera_height", camera_height, 0.3, 4);
  requireInRange("frame_rate_hz", frame_rate_hz, 0.1, 1000);
  requireInRange("readout_time", readout_time, 0, 1 / frame_rate_hz);
  requireInRange("frames", frames, 1, 100000);
  requireInRange("speed", speed, 0.1, 40);
  requireInRange("pitch_rad", pitch_rad, -0.5, 0.5);
  requireInRange("roll_rad", roll_rad, -0.5, 0.5);
  requireInRange("yaw_rad", yaw_rad, -M_PI, M_PI);
  requireInRange("lane_offset", lane_offset, -3.4, 4.6);
  requireInRange("curvature", curvature, 0, 0.08);
  requireInRange("slope", slope, -0.15, 0.15);
  requireInRange("stop_s", stop_s, 0, 3600);
  if (stop_s > 0 && speeds.empty() && path.empty()) {
    const double braking_m = speed * simulation::SpeedProfile::brakingTime(*this) / 2;
    requireInRange("stop_at_m (more than the braking distance)", stop_at_m, 1.001 * braking_m,
                   kMaxDriveLength);
  }
  double time = -1e9, drive_m = speeds.empty() ? speed * frames / frame_rate_hz : 0;
  if (!path.empty()) {
    requireInRange("frames (at most one for each position of the path)", frames, 1,
                   static_cast<double>(path.size()));
    drive_m = 0;  // RecordedPath checks the positions and their length
  }
  for (const SpeedAt& at : speeds) {
    requireInRange("speeds.speed", at.speed, -40, 40);
    requireInRange("speeds.time_s (increasing)", at.time_s, std::nextafter(time, 1e9), 1e6);
    time = at.time_s;
    drive_m = std::max(drive_m, std::abs(at.speed) * frames / frame_rate_hz);
  }
  requireInRange("suspension", suspension, 0, 5);
  requireInRange("ramp_slope", ramp_slope, -0.2, 0.2);
  if (ramp_slope != 0) {
    requireInRange("ramp.from_m", ramp.from_m, 0, kMaxDriveLength);
    requireInRange("ramp.to_m (at least from_m + 12)", ramp.to_m, ramp.from_m + 12,
                   kMaxDriveLength);
  }
  requireInRange("bump_height", bump_height, 0, 0.15);
  requireInRange("road_shift_m", road_shift_m, 0, kMaxDriveLength);
  requireInRange("kerb_height", kerb_height, 0, 0.2);
  requireInRange("lead_gap", lead_gap, 3, 150);
  requireInRange("lead_time", lead_time, 0, 10);
  requireInRange("cars_beside", cars_beside, 0, 10);
  requireInRange("oncoming_spacing", oncoming_spacing, 6, 1000);
  requireInRange("wall_at_m", wall_at_m, 0, kMaxDriveLength);
  if (off_road) requireInRange("wall_at_m (off road)", wall_at_m, 0, 0);
  for (const auto& [name, stretch] :
       {std::pair("bridge", bridge), {"underpass", underpass}, {"bare", bare}}) {
    requireInRange(name, stretch.from_m, -kRoadBehind, kMaxDriveLength);
    requireInRange(name, stretch.to_m, -kRoadBehind, kMaxDriveLength);
  }
  requireInRange("arrow_spacing", arrow_spacing, 0, 1000);
  if (arrow_spacing > 0) requireInRange("arrow_spacing (0: none)", arrow_spacing, 6, 1000);
  requireInRange("road_texture", road_texture, 0, 3);
  requireInRange("grain", grain, 0, 0.5);
  requireInRange("puddles", puddles, 0, 1);
  if (puddles > 0) {  // all water lies in one plane
    requireInRange("slope (with puddles)", slope, 0, 0);
    requireInRange("ramp_slope (with puddles)", ramp_slope, 0, 0);
    requireInRange("bump_height (with puddles)", bump_height, 0, 0);
  }
  requireInRange("sun.norm()", sun.norm(), 1e-3, 1e3);
  requireInRange("elevation of the sun [rad]", std::asin(sun.z() / sun.norm()), 0.1, M_PI / 2);
  requireInRange("daylight", daylight, 0, 1);
  requireInRange("hood", hood, 0, 0.5);
  // The reflection in the hood shows other rows of the same image.
  if (readout_time > 0) requireInRange("hood (with readout_time)", hood, 0, 0);
  requireInRange("noise_sigma", noise_sigma, 0, 50);
  requireInRange("jpeg_quality", jpeg_quality, 0, 100);
  for (const ImageFault& fault : faults) {  // a frozen image is that of the frame before
    requireInRange("faults.frames.first", static_cast<double>(fault.frames.first), 1, 100000);
  }
  requireInRange("length of the drive [m]", drive_m, 0, kMaxDriveLength);
}

}  // namespace ground_scale_vo
