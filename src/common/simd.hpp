#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace gsv {

// Vectors of numbers anywhere in memory (SIMD), for use in functions marked GSV_VECTOR_LOOP. Vector
// types of the compiler, because it does not vectorise the equivalent loops reliably. Functions
// that are not inlined pass them by reference: how they are passed by value depends on the
// instruction set.

constexpr std::size_t kSimdFloats = 8;  // in a vector
constexpr std::size_t kSimdDoubles = 4;

typedef float Floats
    __attribute__((vector_size(kSimdFloats * sizeof(float)), aligned(alignof(float)), may_alias));
typedef std::int32_t Ints __attribute__((vector_size(kSimdFloats * sizeof(std::int32_t)),
                                         aligned(alignof(std::int32_t)), may_alias));
typedef double Doubles __attribute__((vector_size(kSimdDoubles * sizeof(double)),
                                      aligned(alignof(double)), may_alias));

inline const Floats& simd(const float* at) { return *reinterpret_cast<const Floats*>(at); }
inline Floats& simd(float* at) { return *reinterpret_cast<Floats*>(at); }
inline Ints& simd(std::int32_t* at) { return *reinterpret_cast<Ints*>(at); }
inline const Doubles& simd(const double* at) { return *reinterpret_cast<const Doubles*>(at); }
inline Doubles& simd(double* at) { return *reinterpret_cast<Doubles*>(at); }

// In an order of additions that needs few instructions.

inline float total(const Floats& sum) {
  typedef float Half __attribute__((vector_size(kSimdFloats / 2 * sizeof(float))));
  Half halves[2];
  std::memcpy(halves, &sum, sizeof(sum));
  const Half half = halves[0] + halves[1];
  return (half[0] + half[2]) + (half[1] + half[3]);
}
inline double total(const Doubles& sum) { return (sum[0] + sum[2]) + (sum[1] + sum[3]); }

inline void takeSquareRoots(Doubles* values) {
  for (std::size_t i = 0; i < kSimdDoubles; ++i) (*values)[i] = std::sqrt((*values)[i]);
}

/// The next multiple of `unit`.
constexpr std::size_t padded(std::size_t count, std::size_t unit) {
  return (count + unit - 1) / unit * unit;
}

}  // namespace gsv
