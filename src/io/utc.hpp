#pragma once

#include <cstddef>
#include <cstdint>

#include "ground_scale_vo/common/text_file.hpp"

namespace ground_scale_vo {

/// Line i of timestamps.txt, "2011-09-26 13:02:25.964389445" in UTC, as nanoseconds since the
/// epoch. Throws DataError.
std::int64_t readUtc(const TextFile& text, std::size_t i);

}  // namespace ground_scale_vo
