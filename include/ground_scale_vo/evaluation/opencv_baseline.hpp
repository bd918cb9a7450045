#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/vo/feature_tracker.hpp"

namespace ground_scale_vo {

/// Measures OpenCV alone on a drive: image pyramid, corner detection and Lucas-Kanade tracking in
/// every frame, the minimum that a feature tracker computes. points[i]: the pixels to track into
/// image i; points[0] is ignored. Returns a CSV table with a line for every frame from the second
/// on: wall time of each step and of their sum, and processor time of the sum (cpu), in
/// milliseconds.
std::string measureOpencvBaseline(const std::vector<std::vector<cv::Point2f>>& points,
                                  const std::function<cv::Mat(std::size_t)>& image,
                                  const FeatureTracker::Options& options);

}  // namespace ground_scale_vo
