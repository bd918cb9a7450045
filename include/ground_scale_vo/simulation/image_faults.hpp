#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// What goes wrong between the scene and the image.
enum class ImageFault : std::uint8_t {
  kBlack,         ///< no signal: all zero
  kWhite,         ///< blinded: all 255
  kFrozen,        ///< the last image again and again, with new stamps
  kCovered,       ///< something lies before the lens: dark, and nothing sharp
  kCoveredBelow,  ///< mud on the lower two thirds of the lens
  kCoveredLeft,   ///< mud on its left half
  kRain,          ///< streaks in the air, and drops that creep over the lens
  kDarker,        ///< the exposure steps to two fifths
  kBrighter,      ///< the exposure steps to two and a half times: half of the image saturates
  kFlicker        ///< the exposure swings from image to image
};

const char* toString(ImageFault fault);  ///< "black", "white", ... in words

/// Nothing of the ground is to be seen in such an image.
bool hidesTheGround(ImageFault fault);

/// Such an image shows nothing of its scene, so the scene need not be known.
bool needsTheScene(ImageFault fault);

/// The image with the fault, of the same size and 8-bit grey. k counts the fault's images from 0;
/// before: the image before the first of them. image may be empty when it is not needed. The same
/// bytes for the same arguments.
cv::Mat withFault(ImageFault fault, const cv::Mat& image, const cv::Mat& before, std::size_t k,
                  std::uint64_t seed);

}  // namespace ground_scale_vo
