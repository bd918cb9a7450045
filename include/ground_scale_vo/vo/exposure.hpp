#pragma once

#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Factor between the grey levels of two consecutive images after a step of the camera's exposure:
/// the median ratio current / previous of the pixels. Returns 1 when the factor is between 1 / 1.25
/// and 1.25, above 5 or below 1 / 5, when fewer than 20 % of the pixels are unclipped in both
/// images, or when the factor is not significant compared with the variation of the ratios over the
/// image, which image motion causes. Both images: 8-bit grey, same size, small (the coarsest level
/// of a pyramid).
double exposureStep(const cv::Mat& previous, const cv::Mat& current);

/// The image with its grey levels multiplied by factor; for 1 the image itself, not a copy.
cv::Mat applyGain(const cv::Mat& image, double factor);

}  // namespace ground_scale_vo
