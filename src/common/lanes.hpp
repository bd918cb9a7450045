#pragma once

#include <cstddef>

namespace ground_scale_vo {

constexpr std::size_t kLanes = 8;

/// kLanes numbers anywhere in memory. A vector type of the compiler, because it does not vectorise
/// the equivalent loops reliably; for use in functions marked GSV_VECTOR_LOOP.
typedef float Lanes
    __attribute__((vector_size(kLanes * sizeof(float)), aligned(alignof(float)), may_alias));

inline const Lanes& lanes(const float* at) { return *reinterpret_cast<const Lanes*>(at); }
inline Lanes& lanes(float* at) { return *reinterpret_cast<Lanes*>(at); }

inline float total(const Lanes& sum) {
  return ((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]));
}

}  // namespace ground_scale_vo
