#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/vo_options.hpp"
#include "vo/feature.hpp"

namespace gsv {

/// Shi-Tomasi corners, one per cell of a grid. The cell size is a fraction of the image width, so
/// the number of features does not depend on the camera's resolution, unless a cell would be
/// smaller than 8 px.
class CornerDetector {
 public:
  /// mask: 8-bit, one channel, of the images' size, 0 where they never show the scene; empty: none.
  CornerDetector(const OdometryOptions& options, const cv::Mat& mask);

  /// 0 at the pixels where the patch of a corner would contain a masked pixel; empty: no mask.
  const cv::Mat& allowed() const { return allowed_; }

  /// The strongest corner of each allowed cell that holds none of `occupied` [px], at least half a
  /// cell away from these and from each other. Of a large image, in a coarser level.
  std::vector<cv::Point2f> detect(const ImagePyramid& image,
                                  const std::vector<cv::Point2f>& occupied) const;

 private:
  std::vector<cv::Point2f> detectIn(const cv::Mat& image, const cv::Mat& allowed,
                                    const std::vector<cv::Point2f>& occupied) const;

  const OdometryOptions options_;
  cv::Mat allowed_;
};

}  // namespace gsv
