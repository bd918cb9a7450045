#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace ground_scale_vo {

/// [px] Pixels nearer to the image border have no corner strength.
constexpr int kCornerReach = 3;

/// What a corner is, and where one is searched.
struct CornerCriteria {
  int cell_px;          ///< side of the cells of a grid; each holds at most one corner
  int border_px;        ///< without cells, at least kCornerReach + 1
  int half_patch_px;    ///< around the corner, for min_ratio
  double min_strength;  ///< smaller eigenvalue of the gradient matrix, grey levels in [0, 1]
  /// Smaller over larger eigenvalue of the gradient matrix of the patch: 0 on a straight edge.
  double min_ratio;
};

/// The strongest corner of each cell without one of `occupied` [px], at least half a cell away from
/// these and from each other. image: 8-bit grey. allowed: of its size, 0 at pixels that cannot be
/// corners; empty: all can.
std::vector<cv::Point2f> detectCorners(const cv::Mat& image, const cv::Mat& allowed,
                                       const std::vector<cv::Point2f>& occupied,
                                       const CornerCriteria& criteria);

}  // namespace ground_scale_vo
