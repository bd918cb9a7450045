#pragma once

/// What almost every test needs.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "support/expect_throws.hpp"

namespace gsv {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr auto kMaxUint32 = std::numeric_limits<std::uint32_t>::max();

}  // namespace gsv
