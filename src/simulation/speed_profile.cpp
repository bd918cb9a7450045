#include "simulation/speed_profile.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace ground_scale_vo::simulation {
namespace {

constexpr double kMaxAcceleration = 3;  // braking and starting [m/s^2]

}  // namespace

SpeedProfile::SpeedProfile(const SyntheticDrive::Options& options,
                           std::shared_ptr<const RecordedPath> path)
    : cruise_speed_(options.speed),
      braking_s_(brakingTime(options)),
      stop_s_(options.stop_s),
      stop_at_m_(options.stop_at_m),
      brake_at_s_((stop_at_m_ - cruise_speed_ * braking_s_ / 2) / cruise_speed_),
      speeds_(options.speeds),
      path_(std::move(path)) {}

double SpeedProfile::brakingTime(const SyntheticDrive::Options& options) {
  return M_PI * options.speed / (2 * kMaxAcceleration);
}

/// Cruise, one stop between cosine ramps, cruise.
LongitudinalState SpeedProfile::cruise(double t) const {
  const double v = cruise_speed_;
  if (stop_s_ <= 0 || t <= brake_at_s_) return {v * t, v, 0};
  const double stop = brake_at_s_ + braking_s_, start = stop + stop_s_;
  if (t >= stop && t <= start) return {stop_at_m_, 0, 0};
  // Time until the standstill begins or since it ended: the two ramps differ only in sign.
  const double since = t < stop ? stop - t : t - start, sign = t < stop ? -1 : 1;
  if (since >= braking_s_) return {stop_at_m_ + v * (since - braking_s_ / 2), v, 0};
  const double phase = M_PI * since / braking_s_;
  return {stop_at_m_ + sign * v / 2 * (since - braking_s_ / M_PI * std::sin(phase)),
          v / 2 * (1 - std::cos(phase)), sign * v / 2 * M_PI / braking_s_ * std::sin(phase)};
}

/// Cosine ramps between the speeds of the table; s = 0 at its first time.
LongitudinalState SpeedProfile::fromTable(double t) const {
  LongitudinalState state{0, speeds_.front().speed, 0};
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

}  // namespace ground_scale_vo::simulation
