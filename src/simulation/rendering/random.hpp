#pragma once

#include <cstdint>

namespace ground_scale_vo::simulation {

/// SplitMix64. A seed gives the same sequence on every platform; standard-library distributions do
/// not guarantee this.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits();                    ///< 64 random bits
  double uniform(double from, double to);  ///< in [from, to)
  /// True with this probability.
  bool chance(double probability) { return uniform(0, 1) < probability; }

 private:
  std::uint64_t state_;
};

}  // namespace ground_scale_vo::simulation
