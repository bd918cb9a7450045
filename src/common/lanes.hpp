#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace ground_scale_vo {

// Several numbers anywhere in memory, for use in functions marked GSV_VECTOR_LOOP. Vector types of
// the compiler, because it does not vectorise the equivalent loops reliably. Functions that are not
// inlined pass them by reference: how they are passed by value depends on the instruction set.

constexpr std::size_t kLanes = 8;
constexpr std::size_t kDoubleLanes = 4;

typedef float Lanes
    __attribute__((vector_size(kLanes * sizeof(float)), aligned(alignof(float)), may_alias));
typedef std::int32_t IntLanes __attribute__((vector_size(kLanes * sizeof(std::int32_t)),
                                             aligned(alignof(std::int32_t)), may_alias));
typedef double DoubleLanes __attribute__((vector_size(kDoubleLanes * sizeof(double)),
                                          aligned(alignof(double)), may_alias));

inline const Lanes& lanes(const float* at) { return *reinterpret_cast<const Lanes*>(at); }
inline Lanes& lanes(float* at) { return *reinterpret_cast<Lanes*>(at); }
inline IntLanes& lanes(std::int32_t* at) { return *reinterpret_cast<IntLanes*>(at); }
inline const DoubleLanes& lanes(const double* at) {
  return *reinterpret_cast<const DoubleLanes*>(at);
}
inline DoubleLanes& lanes(double* at) { return *reinterpret_cast<DoubleLanes*>(at); }

// In an order of additions that needs few instructions.

inline float total(const Lanes& sum) {
  typedef float Half __attribute__((vector_size(kLanes / 2 * sizeof(float))));
  Half halves[2];
  std::memcpy(halves, &sum, sizeof(sum));
  const Half half = halves[0] + halves[1];
  return (half[0] + half[2]) + (half[1] + half[3]);
}
inline double total(const DoubleLanes& sum) { return (sum[0] + sum[2]) + (sum[1] + sum[3]); }

inline void takeSquareRoots(DoubleLanes* values) {
  for (std::size_t i = 0; i < kDoubleLanes; ++i) (*values)[i] = std::sqrt((*values)[i]);
}

/// The next multiple of kLanes.
constexpr std::size_t wholeLanes(std::size_t count) {
  return (count + kLanes - 1) / kLanes * kLanes;
}
/// The next multiple of kDoubleLanes.
constexpr std::size_t wholeDoubleLanes(std::size_t count) {
  return (count + kDoubleLanes - 1) / kDoubleLanes * kDoubleLanes;
}

}  // namespace ground_scale_vo
