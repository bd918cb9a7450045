#pragma once

#include <cstdint>

namespace ground_scale_vo::simulation {

/// SplitMix64. The sequence of a seed is the same on every platform, unlike that of the
/// distributions of the standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits();
  double uniform(double from, double to);  ///< in [from, to)
  bool chance(double probability) { return uniform(0, 1) < probability; }

 private:
  std::uint64_t state_;
};

}  // namespace ground_scale_vo::simulation
