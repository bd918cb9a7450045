#pragma once

#include <vector>

#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo::simulation {

/// Position along the road and its derivatives [m, m/s, m/s^2].
struct LongitudinalState {
  double s, v, a;
};

/// The position of the car over time. Speed changes follow a cosine.
class SpeedProfile {
 public:
  explicit SpeedProfile(const SyntheticDrive::Options& options);

  /// t [s] may lie before or after the drive.
  LongitudinalState at(double t) const { return speeds_.empty() ? cruise(t) : fromTable(t); }

  /// Time to brake from the cruising speed to standstill [s].
  static double brakingTime(const SyntheticDrive::Options& options);

 private:
  LongitudinalState cruise(double t) const;
  LongitudinalState fromTable(double t) const;

  const double cruise_speed_;  // [m/s]
  const double braking_s_;     // to brake, and to start again [s]
  const double stop_s_;        // at standstill [s]; 0: no stop
  const double stop_at_m_;
  const double brake_at_s_;  // when braking begins [s]
  const std::vector<SyntheticDrive::SpeedAt> speeds_;
};

}  // namespace ground_scale_vo::simulation
