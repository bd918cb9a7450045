#pragma once

namespace ground_scale_vo::simulation {

/// Position along the road and its derivatives [m, m/s, m/s^2].
struct LongitudinalState {
  double s, v, a;
};

}  // namespace ground_scale_vo::simulation
