#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "simulation/synthetic_drive.hpp"
#include "simulation/world/motion.hpp"
#include "simulation/world/road_geometry.hpp"

namespace gsv {

using simulation::kMaxDriveLength;

namespace {

void requireCamera(const SyntheticDrive::Options& o) {
  o.camera.validate();
  requireInRange("camera.width", o.camera.width, 16, 8192);
  requireInRange("camera.height", o.camera.height, 16, 8192);
  requireInRange("camera_height", o.camera_height, 0.3, 4);
  requireInRange("pitch_rad", o.pitch_rad, -0.5, 0.5);
  requireInRange("roll_rad", o.roll_rad, -0.5, 0.5);
  requireInRange("yaw_rad", o.yaw_rad, -M_PI, M_PI);
  requireInRange("frame_rate_hz", o.frame_rate_hz, 0.1, 1000);
  requireInRange("readout_time", o.readout_time, 0, 1 / o.frame_rate_hz);
  // The reflection in the hood shows other rows of the same image.
  if (o.readout_time > 0) requireInRange("hood (with readout_time)", o.hood, 0, 0);
}

/// Also the length of the drive.
void requireMotion(const SyntheticDrive::Options& o) {
  requireInRange("frames", o.frames, 1, 100000);
  requireInRange("speed", o.speed, 0.1, 40);
  requireInRange("stop_s", o.stop_s, 0, 3600);
  requireInRange("suspension", o.suspension, 0, 5);
  if (!o.path.empty()) {  // RecordedPath checks the positions and their length
    requireInRange("frames (at most one for each position of the path)", o.frames, 1,
                   static_cast<double>(o.path.size()));
    return;
  }
  if (o.stop_s > 0 && o.speeds.empty()) {
    const double braking_m = o.speed * simulation::SpeedProfile::brakingTime(o) / 2;
    requireInRange("stop_at_m (more than the braking distance)", o.stop_at_m, 1.001 * braking_m,
                   kMaxDriveLength);
  }
  double time = -1e9, top_speed = o.speeds.empty() ? o.speed : 0;
  for (const SyntheticDrive::SpeedAt& at : o.speeds) {
    requireInRange("speeds.time_s (increasing)", at.time_s, std::nextafter(time, 1e9), 1e6);
    time = at.time_s;
    top_speed = std::max(top_speed, std::abs(at.speed));
  }
  requireInRange("length of the drive [m]", top_speed * o.frames / o.frame_rate_hz, 0,
                 kMaxDriveLength);
}

void requireRoad(const SyntheticDrive::Options& o) {
  requireInRange("curvature", o.curvature, 0, 0.08);
  requireInRange("slope", o.slope, -0.15, 0.15);
  if (o.puddles > 0) {  // all water lies in one plane
    requireInRange("slope (with puddles)", o.slope, 0, 0);
    requireInRange("ramp_slope (with puddles)", o.ramp_slope, 0, 0);
    requireInRange("bump_height (with puddles)", o.bump_height, 0, 0);
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
  for (const ImageFault& fault : faults) {  // a frozen image is that of the frame before
    requireInRange("faults.frames.first", static_cast<double>(fault.frames.first), 1, 100000);
  }
}

}  // namespace gsv
