#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "ground_scale_vo/scale/speed.hpp"

namespace ground_scale_vo {

/// The speeds of the last minutes, and the distances that follow from them. Between two samples the
/// speed is interpolated linearly. Samples from a jump that no vehicle makes (a wheel that slips or
/// locks, a sensor that fails) to the jump back are left out; a new level counts after a
/// while.
class SpeedTrack {
 public:
  /// [s] Longest interval between two samples without a gap; also how far the newest one reaches.
  static constexpr double kMaxInterval = 2.5;

  struct Distance {
    double metres = 0;  ///< signed: back and forth cancel each other
    double sigma = 0;   ///< standard deviation [m] from the noise of the samples
  };

  /// sigma: of a sample that has none [m/s].
  explicit SpeedTrack(double sigma) : default_sigma_(sigma) {}

  /// Adds a sample. Ignored: not finite, implausibly fast, or not later than the newest one; a
  /// stamp more than kMaxInterval before the newest one starts anew (the clock was set back).
  void add(const SpeedSample& sample);

  /// Travelled between two stamps. Empty when samples do not cover the time, or there is a gap.
  std::optional<Distance> distance(std::int64_t from_ns, std::int64_t to_ns) const;

  /// [m/s] Interpolated; of the nearest sample outside their time. Precondition: not empty.
  double speedAt(std::int64_t stamp_ns) const;

  /// Whether the vehicle has stood still since from_ns: the sensor has been zero since then,
  /// reaches up to to_ns, and slowed down before. A sensor that jumps to zero, or has never been
  /// anything else, is taken to have failed.
  bool standsStill(std::int64_t from_ns, std::int64_t to_ns) const;
  bool isZero() const;  ///< the newest sample; false when there is none
  /// The vehicle moves although the newest samples are zero: they are no stop.
  void ignoreZero() { zero_is_stop_ = false; }

  /// Whether the newest samples repeat one value other than zero for so long that the sensor may be
  /// stuck.
  bool repeats() const { return repeated_ >= kMinRepeated && repeated_s_ > kMinRepeatedTime; }

  /// Whether the latest speeds agree with the motion of the odometry, as its user has found. Those
  /// that do not are of no use where the odometry has no pose.
  bool agrees() const { return agrees_; }
  void setAgrees(bool agrees) { agrees_ = agrees; }

  bool empty() const { return samples_.empty(); }
  const SpeedSample& newest() const { return newest_; }   ///< also one that is left out
  bool jumped() const { return jumped_ns_.has_value(); }  ///< the newest one is left out
  const std::deque<SpeedSample>& samples() const { return samples_; }

 private:
  static constexpr int kMinRepeated = 5;           ///< [samples]
  static constexpr double kMinRepeatedTime = 1.5;  ///< [s]

  bool jumps(const SpeedSample& sample) const;
  bool updateJump(const SpeedSample& sample);
  void updateRuns(const SpeedSample& sample);

  double default_sigma_;
  bool agrees_ = false;
  SpeedSample newest_;                     ///< also one that is left out
  std::optional<std::int64_t> jumped_ns_;  ///< samples are left out since then
  std::deque<SpeedSample> samples_;        ///< in order of the stamps
  int repeated_ = 0;                       ///< [samples] with the value of the newest one
  double repeated_s_ = 0;
  bool has_moved_ = false;     ///< any sample was not zero
  bool zero_is_stop_ = false;  ///< the newest sample is zero, and the speed before was low
};

}  // namespace ground_scale_vo
