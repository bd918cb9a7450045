#pragma once

#include <cstdint>

namespace ground_scale_vo {

/// [s] from one stamp [ns] to another; negative when `to_ns` is the earlier one.
inline double secondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}

}  // namespace ground_scale_vo
