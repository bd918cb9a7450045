#pragma once

#include <cstdint>

namespace ground_scale_vo {

/// Largest side [px] and number of pixels of an image: sizes beyond are errors of the sender. They
/// keep products of sizes within their types and the memory of one image within 100 MB.
constexpr std::uint32_t kMaxImageSide = 100000;
constexpr double kMaxImagePixels = 1e8;

}  // namespace ground_scale_vo
