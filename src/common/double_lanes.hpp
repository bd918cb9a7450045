#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace ground_scale_vo {

constexpr std::size_t kDoubleLanes = 4;
/// kDoubleLanes numbers anywhere in memory. A vector type of the compiler, because it does not
/// vectorise the equivalent loops reliably. Functions pass it by reference: how it is passed by
/// value depends on the instruction set.
typedef double DoubleLanes __attribute__((vector_size(kDoubleLanes * sizeof(double)),
                                          aligned(alignof(double)), may_alias));

inline const DoubleLanes& lanes(const double* at) {
  return *reinterpret_cast<const DoubleLanes*>(at);
}
inline DoubleLanes& lanes(double* at) { return *reinterpret_cast<DoubleLanes*>(at); }

inline double total(const DoubleLanes& sum) { return (sum[0] + sum[2]) + (sum[1] + sum[3]); }

inline void takeSquareRoots(DoubleLanes* values) {
  for (std::size_t i = 0; i < kDoubleLanes; ++i) (*values)[i] = std::sqrt((*values)[i]);
}

/// The next multiple of kDoubleLanes.
inline std::size_t roundUpToLanes(std::size_t count) {
  return (count + kDoubleLanes - 1) / kDoubleLanes * kDoubleLanes;
}

}  // namespace ground_scale_vo
