#pragma once

#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// Whether the square of half side `reach` [px] around u contains a masked pixel (0). mask: as for
/// VisualOdometry, may be empty.
inline bool touchesMask(const cv::Mat& mask, const cv::Point2f& u, int reach) {
  if (mask.empty()) return false;
  const cv::Rect square(cvRound(u.x) - reach, cvRound(u.y) - reach, 2 * reach + 1, 2 * reach + 1);
  const cv::Rect inside = square & cv::Rect({0, 0}, mask.size());
  return cv::countNonZero(mask(inside)) < inside.area();
}

}  // namespace ground_scale_vo
