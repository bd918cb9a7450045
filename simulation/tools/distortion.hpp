#pragma once

#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/lens/lens.hpp"

namespace gsv {

/// Turns images of a camera without distortion into those that a camera with another lens takes at
/// the same place.
class Distortion {
 public:
  /// camera: of the given images; lens: of the resulting ones, which have the same size.
  Distortion(const PinholeCamera& camera, const Lens& lens)
      : map_(camera.height, camera.width, CV_32FC2) {
    for (int v = 0; v < map_.rows; ++v) {
      for (int u = 0; u < map_.cols; ++u) {
        const Eigen::Vector2d source = camera.project(lens.unproject({u, v}).homogeneous());
        map_.at<cv::Vec2f>(v, u) = {static_cast<float>(source.x()), static_cast<float>(source.y())};
      }
    }
  }

  cv::Mat image(const cv::Mat& image) const {
    cv::Mat result;
    cv::remap(image, result, map_, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    return result;
  }

 private:
  cv::Mat map_;  ///< pixel of the given image for each pixel of the resulting one
};

}  // namespace gsv
