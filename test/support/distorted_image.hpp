#pragma once

#include <opencv2/imgproc.hpp>

#include "ground_scale_vo/lens/lens.hpp"

namespace ground_scale_vo {

/// The image that a camera with this lens takes of what `image` shows without distortion.
inline cv::Mat distorted(const cv::Mat& image, const Lens& lens) {
  cv::Mat map(image.size(), CV_32FC2);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const Eigen::Vector2d source = lens.camera.project(lens.unproject({u, v}).homogeneous());
      map.at<cv::Vec2f>(v, u) = {static_cast<float>(source.x()), static_cast<float>(source.y())};
    }
  }
  cv::Mat result;
  cv::remap(image, result, map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  return result;
}

}  // namespace ground_scale_vo
