#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "vo/feature.hpp"

namespace gsv {

constexpr int kTrackedSide = 9;    ///< [px] side of a patch
constexpr int kPyramidLevels = 4;  ///< above the full resolution

/// The image, 8-bit grey, and at most kPyramidLevels smaller ones, each half the size of the one
/// before; none smaller than a patch. Copies, with a border in memory.
ImagePyramid trackingPyramid(const cv::Mat& image);

/// Where the patches around `points` [px] of one image are in the next one; empty when a patch is
/// not found, ends at a pixel where `allowed` is 0 (empty: none is), or is not found back from
/// there. predicted: initial guess of each point; empty: none. A point that is not found near its
/// guess is searched once more over all pyramid levels, starting from its position in `from`.
std::vector<std::optional<cv::Point2f>> trackPoints(const ImagePyramid& from,
                                                    const ImagePyramid& to,
                                                    const std::vector<cv::Point2f>& points,
                                                    const std::vector<cv::Point2f>& predicted,
                                                    const cv::Mat& allowed);

}  // namespace gsv
