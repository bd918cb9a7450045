#pragma once

#include <cstdint>

namespace ground_scale_vo {

/// Largest side [px] and number of pixels of an image; a larger one is an error of the sender. The
/// limits keep products of sizes within their types and an 8-bit grey image within 100 MB.
constexpr std::uint32_t kMaxImageSide = 100000;
constexpr double kMaxImagePixels = 1e8;

}  // namespace ground_scale_vo
