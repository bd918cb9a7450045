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

namespace {

void requireCamera(const SyntheticDrive::Options& o) {
  o.camera.validate();
  requireInRange("camera.width", o.camera.width, 16, 8192);
  requireInRange("camera.height", o.camera.height, 16, 8192);
  requireInRange("camera_height", o.camera_height, 0.3, 4);
  requireInRange("frame_rate_hz", o.frame_rate_hz, 0.1, 1000);
  requireInRange("readout_time", o.readout_time, 0, 1 / o.frame_rate_hz);
  requireInRange("frames", o.frames, 1, 100000);
}

/// Also the length of the drive.
void requireMotion(const SyntheticDrive::Options& o) {
  requireInRange("speed", o.speed, 0.1, 40);
  requireInRange("pitch_rad", o.pitch_rad, -0.5, 0.5);
  requireInRange("roll_rad", o.roll_rad, -0.5, 0.5);
  requireInRange("yaw_rad", o.yaw_rad, -M_PI, M_PI);
  requireInRange("lane_offset", o.lane_offset, -3.4, 4.6);
  requireInRange("stop_s", o.stop_s, 0, 3600);
  if (o.stop_s > 0 && o.speeds.empty() && o.path.empty()) {
    const double braking_m = o.speed * simulation::SpeedProfile::brakingTime(o) / 2;
    requireInRange("stop_at_m (more than the braking distance)", o.stop_at_m, 1.001 * braking_m,
                   kMaxDriveLength);
  }
  double time = -1e9, drive_m = o.speeds.empty() ? o.speed * o.frames / o.frame_rate_hz : 0;
  if (!o.path.empty()) {
    requireInRange("frames (at most one for each position of the path)", o.frames, 1,
                   static_cast<double>(o.path.size()));
    drive_m = 0;  // RecordedPath checks the positions and their length
  }
  for (const SyntheticDrive::SpeedAt& at : o.speeds) {
    requireInRange("speeds.speed", at.speed, -40, 40);
    requireInRange("speeds.time_s (increasing)", at.time_s, std::nextafter(time, 1e9), 1e6);
    time = at.time_s;
    drive_m = std::max(drive_m, std::abs(at.speed) * o.frames / o.frame_rate_hz);
  }
  requireInRange("suspension", o.suspension, 0, 5);
  requireInRange("length of the drive [m]", drive_m, 0, kMaxDriveLength);
}

void requireRoad(const SyntheticDrive::Options& o) {
  requireInRange("curvature", o.curvature, 0, 0.08);
  requireInRange("slope", o.slope, -0.15, 0.15);
  requireInRange("ramp_slope", o.ramp_slope, -0.2, 0.2);
  if (o.ramp_slope != 0) {
    requireInRange("ramp.from_m", o.ramp.from_m, 0, kMaxDriveLength);
    requireInRange("ramp.to_m (at least from_m + 12)", o.ramp.to_m, o.ramp.from_m + 12,
                   kMaxDriveLength);
  }
  requireInRange("bump_height", o.bump_height, 0, 0.15);
  requireInRange("road_shift_m", o.road_shift_m, 0, kMaxDriveLength);
  requireInRange("kerb_height", o.kerb_height, 0, 0.2);
}

void requireSurroundings(const SyntheticDrive::Options& o) {
  requireInRange("lead_gap", o.lead_gap, 3, 150);
  requireInRange("lead_time", o.lead_time, 0, 10);
  requireInRange("cars_beside", o.cars_beside, 0, 10);
  requireInRange("oncoming_spacing", o.oncoming_spacing, 6, 1000);
  requireInRange("wall_at_m", o.wall_at_m, 0, kMaxDriveLength);
  if (o.off_road) requireInRange("wall_at_m (off road)", o.wall_at_m, 0, 0);
  for (const auto& [name, stretch] :
       {std::pair("bridge", o.bridge), {"underpass", o.underpass}, {"bare", o.bare}}) {
    requireInRange(name, stretch.from_m, -kRoadBehind, kMaxDriveLength);
    requireInRange(name, stretch.to_m, -kRoadBehind, kMaxDriveLength);
  }
}

void requireSurfaceAndImage(const SyntheticDrive::Options& o) {
  requireInRange("arrow_spacing", o.arrow_spacing, 0, 1000);
  if (o.arrow_spacing > 0) requireInRange("arrow_spacing (0: none)", o.arrow_spacing, 6, 1000);
  requireInRange("road_texture", o.road_texture, 0, 3);
  requireInRange("grain", o.grain, 0, 0.5);
  requireInRange("puddles", o.puddles, 0, 1);
  if (o.puddles > 0) {  // all water lies in one plane
    requireInRange("slope (with puddles)", o.slope, 0, 0);
    requireInRange("ramp_slope (with puddles)", o.ramp_slope, 0, 0);
    requireInRange("bump_height (with puddles)", o.bump_height, 0, 0);
  }
  requireInRange("sun.norm()", o.sun.norm(), 1e-3, 1e3);
  requireInRange("elevation of the sun [rad]", std::asin(o.sun.z() / o.sun.norm()), 0.1, M_PI / 2);
  requireInRange("daylight", o.daylight, 0, 1);
  requireInRange("hood", o.hood, 0, 0.5);
  // The reflection in the hood shows other rows of the same image.
  if (o.readout_time > 0) requireInRange("hood (with readout_time)", o.hood, 0, 0);
  requireInRange("noise_sigma", o.noise_sigma, 0, 50);
  requireInRange("jpeg_quality", o.jpeg_quality, 0, 100);
  for (const ImageFault& fault : o.faults) {  // a frozen image is that of the frame before
    requireInRange("faults.frames.first", static_cast<double>(fault.frames.first), 1, 100000);
  }
}

}  // namespace

SyntheticDrive::Options::Options() {
  camera.width = 800;
  camera.height = 248;
  camera.fx = camera.fy = 464;
  camera.cx = 394;
  camera.cy = 121;
}

void SyntheticDrive::Options::validate() const {
  requireCamera(*this);
  requireMotion(*this);
  requireRoad(*this);
  requireSurroundings(*this);
  requireSurfaceAndImage(*this);
}

}  // namespace ground_scale_vo
