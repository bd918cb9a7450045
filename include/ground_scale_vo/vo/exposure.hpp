#pragma once

#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// By which factor all grey levels have changed between two images of nearly the same scene: a step
/// of the camera's exposure. 1 when there is none: less than a quarter of change is none, and a
/// change must stand out of what single places have changed by, so motion is none. Both 8-bit grey,
/// of one size, small (a pyramid's top will do).
double exposureStep(const cv::Mat& before, const cv::Mat& now);

/// The image with its grey levels times factor; the image itself, not a copy, for 1.
cv::Mat applyGain(const cv::Mat& image, double factor);

}  // namespace ground_scale_vo
