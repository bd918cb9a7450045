#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

namespace gsv {

/// Frames first to last of a drive; last < first: none.
struct FrameRange {
  std::size_t first = 1, last = 0;
  bool isEmpty() const { return last < first; }
  bool contains(std::size_t i) const { return i >= first && i <= last; }
};

/// Faults of lens, exposure and camera driver.
enum class FaultKind : std::uint8_t {
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

struct ImageFault {
  FaultKind kind;
  FrameRange frames;
};

/// Image k of a fault: 8-bit, one channel. image: without the fault; with kFrozen the last one
/// before it; with kBlack and kWhite only its size is used. Deterministic.
cv::Mat withFault(FaultKind kind, const cv::Mat& image, std::size_t k, std::uint64_t seed);

}  // namespace gsv
