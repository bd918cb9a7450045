#include "simulation/world/motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace gsv::simulation {
namespace {

constexpr double kMaxAcceleration = 3;  // braking and starting [m/s^2]

constexpr double kFrontAxle = 1.4, kRearAxle = 1.2;  // before and behind the camera [m]

// Suspension: a quasi-static response to accelerations, and vibrations as sines of the distance
// travelled.
constexpr double kRollPerLateral = 0.0035;       // [rad/(m/s^2)]
constexpr double kPitchPerLongitudinal = 0.004;  // [rad/(m/s^2)]

constexpr double kVibrationRoll = 0.003;  // amplitude at the cruising speed [rad]

/// Offsets at the cruising speed [rad, m].
double vibrationPitch(double s) {
  return 0.003 * std::sin(0.9 * s) + 0.0018 * std::sin(2.1 * s + 1);
}
double vibrationHeight(double s) {
  return 0.012 * std::sin(1.1 * s + 0.5) + 0.006 * std::sin(2.3 * s);
}

/// World from road below the camera: x forward, y left, z up. On a road with a ramp or bumps its
/// x-y plane passes through the contact points of both axles.
Eigen::Isometry3d groundFrame(const RoadGeometry& road, double s,
                              const SyntheticDrive::Options& options) {
  Eigen::Isometry3d T_w_s = road.surfaceFrame(s, options.lane_offset);
  if (options.ramp_slope == 0 && options.bump_height == 0) return T_w_s;
  const double front = road.surfacePoint(s + kFrontAxle, 0).z();
  const double rear = road.surfacePoint(s - kRearAxle, 0).z();
  const double slope = (front - rear) / (kFrontAxle + kRearAxle);
  const Eigen::Vector3d y = T_w_s.linear().col(1);
  const Eigen::Vector3d x = Eigen::Vector3d(y.y(), -y.x(), slope).normalized();
  T_w_s.linear() << x, y, x.cross(y);
  T_w_s.translation().z() = rear + slope * kRearAxle;
  return T_w_s;
}

/// pitch: positive looks down; roll: positive lowers the x axis of the camera.
Eigen::Isometry3d rotated(Eigen::Isometry3d T_w_c, double pitch, double roll) {
  T_w_c.rotate(Eigen::AngleAxisd(-pitch, Eigen::Vector3d::UnitX()));
  T_w_c.rotate(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
  return T_w_c;
}

std::vector<SyntheticDrive::SpeedAt> cruiseWithStop(const SyntheticDrive::Options& o) {
  if (o.stop_s <= 0) return {{0, o.speed}};
  const double braking = SpeedProfile::brakingTime(o);
  const double stop = o.stop_at_m / o.speed + braking / 2, start = stop + o.stop_s;
  return {
      {0, o.speed}, {stop - braking, o.speed}, {stop, 0}, {start, 0}, {start + braking, o.speed}};
}

}  // namespace

SpeedProfile::SpeedProfile(const SyntheticDrive::Options& options,
                           std::shared_ptr<const RecordedPath> path)
    : speeds_(options.speeds.empty() ? cruiseWithStop(options) : options.speeds),
      path_(std::move(path)) {}

double SpeedProfile::brakingTime(const SyntheticDrive::Options& options) {
  return M_PI * options.speed / (2 * kMaxAcceleration);
}

LongitudinalState SpeedProfile::at(double t) const {
  if (path_) return path_->at(t);
  LongitudinalState state{0, speeds_.front().speed, 0};  // s = 0 at the first time
  double since = t - speeds_.front().time_s;
  for (std::size_t k = 1; k < speeds_.size() && since > 0; ++k) {
    const double duration = speeds_[k].time_s - speeds_[k - 1].time_s;
    const double change = speeds_[k].speed - speeds_[k - 1].speed;
    const double elapsed = std::min(since, duration), phase = M_PI * elapsed / duration;
    state.s += (state.v + change / 2) * elapsed - change / 2 * duration / M_PI * std::sin(phase);
    state.a = since < duration ? change / 2 * M_PI / duration * std::sin(phase) : 0;
    state.v += change / 2 * (1 - std::cos(phase));
    since -= elapsed;
  }
  state.s += state.v * since;
  return state;
}

VehiclePose vehiclePose(const RoadGeometry& road, const LongitudinalState& state,
                        const SyntheticDrive::Options& options) {
  const double v = state.v;
  const double vibration = options.suspension * v / options.speed;  // none at standstill
  const double lean = options.suspension * kRollPerLateral * v * v * road.curvature(state.s);
  const double shake = vibration * vibrationPitch(state.s);
  const double nod = options.suspension * kPitchPerLongitudinal * state.a;
  const double roll = lean + vibration * kVibrationRoll * std::sin(0.7 * state.s + 2);
  const double bounce = vibration * vibrationHeight(state.s);

  const Eigen::Isometry3d T_w_s = groundFrame(road, state.s, options);
  Eigen::Matrix3d R_s_c;
  R_s_c << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  VehiclePose pose;
  pose.n_w = T_w_s.linear().col(2);
  pose.height = options.camera_height + bounce;
  Eigen::Isometry3d T_w_level = T_w_s;  // the camera without mounting and suspension angles
  T_w_level.translate(pose.height * Eigen::Vector3d::UnitZ());
  T_w_level.rotate(R_s_c);
  pose.T_w_body = rotated(T_w_level, shake - nod, roll);
  // Pitch and roll of the vehicle, about the axes of the camera turned by the yaw.
  const double cosine = std::cos(options.yaw_rad), sine = std::sin(options.yaw_rad);
  const double pitch_c = cosine * (shake - nod) - sine * roll;
  const double roll_c = cosine * roll + sine * (shake - nod);
  T_w_level.rotate(Eigen::AngleAxisd(-options.yaw_rad, Eigen::Vector3d::UnitY()));
  pose.T_w_c = rotated(T_w_level, options.pitch_rad + pitch_c, options.roll_rad + roll_c);
  return pose;
}

}  // namespace gsv::simulation
