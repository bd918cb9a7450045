#pragma once

#include <cstdint>
#include <cstdlib>
#include <string>

#include "ground_scale_vo/common/format.hpp"

namespace ground_scale_vo {

/// [s] from one stamp [ns] to another; negative when `to_ns` is the earlier one.
inline double secondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}

/// Seconds with nine decimals.
inline std::string formatSeconds(std::int64_t stamp_ns) {
  constexpr std::int64_t kSecond = 1000000000;
  return format("%s%lld.%09lld", stamp_ns < 0 ? "-" : "",
                static_cast<long long>(std::abs(stamp_ns / kSecond)),
                static_cast<long long>(std::abs(stamp_ns % kSecond)));
}

}  // namespace ground_scale_vo
