#include "scale/speed_track.hpp"

#include <algorithm>
#include <cmath>

#include "common/time.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kMaxSampleSpeed = 200;  ///< [m/s]
constexpr double kZero = 0.02;           ///< [m/s] resolution of a sensor
constexpr double kLastBeforeStop = 2;    ///< [m/s] speed of the last sample before a stop, at most
constexpr double kTrackMemory = 120;     ///< [s]
constexpr double kMinJump = 1;           ///< [m/s]
constexpr double kMaxAcceleration = 12;  ///< [m/s^2]
constexpr double kMaxJumpTime = 4;       ///< [s]
/// [m/s^2] Standard deviation of the acceleration's change between two samples.
constexpr double kAccelerationSigma = 1;
constexpr std::size_t kMaxSamples = 20000;

double interpolate(const SpeedSample& a, const SpeedSample& b, std::int64_t stamp_ns) {
  const double share =
      static_cast<double>(stamp_ns - a.stamp_ns) / static_cast<double>(b.stamp_ns - a.stamp_ns);
  return a.speed + share * (b.speed - a.speed);
}

std::deque<SpeedSample>::const_iterator firstAfter(const std::deque<SpeedSample>& samples,
                                                   std::int64_t stamp_ns) {
  return std::upper_bound(
      samples.begin(), samples.end(), stamp_ns,
      [](std::int64_t stamp, const SpeedSample& sample) { return stamp < sample.stamp_ns; });
}

}  // namespace

void SpeedTrack::add(const SpeedSample& sample) {
  if (!areFinite(sample.speed, sample.sigma) || std::abs(sample.speed) > kMaxSampleSpeed) return;
  if (!samples_.empty()) {
    const double dt = secondsBetween(newest_.stamp_ns, sample.stamp_ns);
    if (dt < -kMaxInterval) {
      *this = SpeedTrack(default_sigma_);
    } else if (dt <= 0) {
      return;
    }
  }
  const bool is_left_out = !samples_.empty() && updateJump(sample);
  if (!samples_.empty()) updateRuns(sample);
  newest_ = sample;
  has_moved_ = has_moved_ || std::abs(sample.speed) >= kZero;
  if (is_left_out) return;
  samples_.push_back(sample);
  if (!(sample.sigma > 0)) samples_.back().sigma = default_sigma_;
  while (samples_.size() > kMaxSamples ||
         secondsBetween(samples_.front().stamp_ns, sample.stamp_ns) > kTrackMemory) {
    samples_.pop_front();
  }
}

bool SpeedTrack::isZero() const { return !empty() && std::abs(newest_.speed) < kZero; }

/// From the newest sample: faster than any vehicle accelerates or brakes.
bool SpeedTrack::jumps(const SpeedSample& sample) const {
  const double dt = secondsBetween(newest_.stamp_ns, sample.stamp_ns);
  return std::abs(sample.speed - newest_.speed) > kMinJump + kMaxAcceleration * dt;
}

/// Whether the sample is left out.
bool SpeedTrack::updateJump(const SpeedSample& sample) {
  if (!jumped_ns_) {
    if (jumps(sample)) jumped_ns_ = sample.stamp_ns;
  } else if (jumps(sample) || secondsBetween(*jumped_ns_, sample.stamp_ns) > kMaxJumpTime) {
    jumped_ns_.reset();
  }
  return jumped_ns_.has_value();
}

/// Runs of the same value, and of zeros.
void SpeedTrack::updateRuns(const SpeedSample& sample) {
  const double dt = secondsBetween(newest_.stamp_ns, sample.stamp_ns);
  const bool is_zero = std::abs(sample.speed) < kZero, was_zero = std::abs(newest_.speed) < kZero;
  const bool repeats = sample.speed == newest_.speed && !is_zero;
  repeated_ = repeats ? repeated_ + 1 : 0;
  repeated_s_ = repeats ? repeated_s_ + dt : 0;
  if (!is_zero) {
    zero_is_stop_ = false;
  } else if (!was_zero) {
    zero_is_stop_ = dt <= kMaxInterval && !jumped_ns_ && std::abs(newest_.speed) < kLastBeforeStop;
  }
}

std::optional<SpeedTrack::Distance> SpeedTrack::distance(std::int64_t from_ns,
                                                         std::int64_t to_ns) const {
  auto next = firstAfter(samples_, from_ns);
  if (next == samples_.begin() || !(from_ns < to_ns)) return std::nullopt;
  Distance distance;
  double variance = 0;
  for (auto previous = next - 1; previous->stamp_ns < to_ns; previous = next++) {
    if (next == samples_.end()) return std::nullopt;
    if (secondsBetween(previous->stamp_ns, next->stamp_ns) > kMaxInterval) return std::nullopt;
    const std::int64_t a_ns = std::max(from_ns, previous->stamp_ns);
    const std::int64_t b_ns = std::min(to_ns, next->stamp_ns);
    const double dt = secondsBetween(a_ns, b_ns);
    distance.metres +=
        0.5 * dt * (interpolate(*previous, *next, a_ns) + interpolate(*previous, *next, b_ns));
    // The noise of the samples is white; one sample holds for the interval between two.
    const double interval = secondsBetween(previous->stamp_ns, next->stamp_ns);
    variance += next->sigma * next->sigma * dt * interval +
                std::pow(kAccelerationSigma * interval * dt / 12, 2);
  }
  distance.sigma = std::sqrt(variance);
  return distance;
}

double SpeedTrack::speedAt(std::int64_t stamp_ns) const {
  const auto next = firstAfter(samples_, stamp_ns);
  if (next == samples_.begin()) return next->speed;
  return next == samples_.end() ? samples_.back().speed : interpolate(*(next - 1), *next, stamp_ns);
}

bool SpeedTrack::standsStill(std::int64_t from_ns, std::int64_t to_ns) const {
  if (samples_.size() < 2 || !has_moved_) return false;
  // As far as the next sample is not due yet.
  const SpeedSample& newest = samples_.back();
  const double interval = secondsBetween(samples_[samples_.size() - 2].stamp_ns, newest.stamp_ns);
  if (secondsBetween(newest.stamp_ns, to_ns) > 1.2 * interval) return false;
  for (auto sample = samples_.rbegin(); sample != samples_.rend(); ++sample) {
    if (std::abs(sample->speed) >= kZero) return false;
    if (sample->stamp_ns <= from_ns) return zero_is_stop_;
  }
  return false;
}

}  // namespace ground_scale_vo
