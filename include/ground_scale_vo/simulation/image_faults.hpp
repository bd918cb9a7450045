#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Faults of lens, exposure and camera driver that can be injected into an image. hidesGround() and
/// needsScene() depend on their order.
enum class ImageFault : std::uint8_t {
  kBlack,         ///< no signal: all pixels 0
  kWhite,         ///< saturated: all pixels 255
  kFrozen,        ///< the last good image again and again, with new stamps
  kCovered,       ///< the lens is covered: dark and blurred
  kCoveredBelow,  ///< mud on the lower two thirds of the lens
  kCoveredLeft,   ///< mud on the left half of the lens
  kRain,          ///< streaks in the air, and drops that creep down the lens
  kDarker,        ///< the exposure drops to 40 %
  kBrighter,      ///< the exposure rises to 250 %: half of the image saturates
  kFlicker        ///< the exposure varies from image to image
};

const char* toString(ImageFault fault);  ///< "black", "white", "covered below", ...

/// True when the image shows no part of the ground at its time; a frozen image shows an earlier
/// part.
bool hidesGround(ImageFault fault);

/// False when the faulty image does not depend on the scene, so that it need not be rendered.
bool needsScene(ImageFault fault);

/// The faulty image: same size, 8-bit, one channel. image: may be empty unless needsScene(fault).
/// last_good: the image before the first faulty one. k: index of the image within the fault.
/// Deterministic.
cv::Mat injectFault(ImageFault fault, const cv::Mat& image, const cv::Mat& last_good, std::size_t k,
                    std::uint64_t seed);

}  // namespace ground_scale_vo
