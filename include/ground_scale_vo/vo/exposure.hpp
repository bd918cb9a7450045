#pragma once

#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Factor between the grey levels of two consecutive images after a step of the camera's exposure:
/// the median ratio of the pixels. 1 when the change is smaller than a quarter, or not significant
/// compared with the variation of the ratios over the image, which image motion causes. Both
/// images: 8-bit grey, same size, small (the coarsest level of a pyramid).
double exposureStep(const cv::Mat& before, const cv::Mat& now);

/// The image with its grey levels multiplied by factor; for 1 the image itself, not a copy.
cv::Mat applyGain(const cv::Mat& image, double factor);

}  // namespace ground_scale_vo
