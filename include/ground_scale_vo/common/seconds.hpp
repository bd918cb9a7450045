#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "ground_scale_vo/common/format.hpp"

namespace ground_scale_vo {

/// [s] from one stamp [ns] to another; negative when `to_ns` is the earlier one.
inline double secondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}

/// Stamp [ns] of image i of images at a constant rate [Hz], from 0 on.
inline std::int64_t stampAtRate(std::size_t i, double rate_hz) {
  return std::llround(1e9 * static_cast<double>(i) / rate_hz);
}

/// Seconds with nine decimals.
inline std::string formatSeconds(std::int64_t stamp_ns) {
  constexpr std::int64_t kSecond = 1000000000;
  return format("%s%lld.%09lld", stamp_ns < 0 ? "-" : "",
                static_cast<long long>(std::abs(stamp_ns / kSecond)),
                static_cast<long long>(std::abs(stamp_ns % kSecond)));
}

}  // namespace ground_scale_vo
