#pragma once

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {

/// A hood with a texture that is fixed to the camera (rust, stickers, dirt) over the lowest part of
/// the images.
class TexturedHood {
 public:
  /// size: of the images. share: of their height.
  TexturedHood(const cv::Size& size, double share)
      : top_(static_cast<int>(std::lround((1 - share) * size.height))),
        hood_(size.height - top_, size.width, CV_8U) {
    cv::RNG(3).fill(hood_, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(hood_, hood_, {0, 0}, 1.5);
    cv::normalize(hood_, hood_, 20, 235, cv::NORM_MINMAX);
  }

  int top() const { return top_; }  ///< its first row
  cv::Mat cover(const cv::Mat& image) const {
    cv::Mat covered = image.clone();
    hood_.copyTo(covered.rowRange(top_, covered.rows));
    return covered;
  }
  /// The mask of MetricOdometry: 0 at the hood.
  cv::Mat mask() const {
    cv::Mat mask(top_ + hood_.rows, hood_.cols, CV_8U, cv::Scalar(255));
    mask.rowRange(top_, mask.rows).setTo(0);
    return mask;
  }

 private:
  int top_;
  cv::Mat hood_;
};

}  // namespace ground_scale_vo
