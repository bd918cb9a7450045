#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

namespace ground_scale_vo::direct {

/// Smooths parts of images with a Gaussian, like cv::sepFilter2D() with its default border, which
/// takes several times as long.
class Smoothing {
 public:
  static constexpr int kMaxRadius = 3;  ///< [px] of the filter

  /// sigma: of the Gaussian [px].
  explicit Smoothing(double sigma);

  int radius() const { return radius_; }  ///< [px] of the filter, at most kMaxRadius

  /// source: CV_8UC1 or CV_32FC1. area: the part of it to be smoothed; the pixels around it count,
  /// and those outside the source are its reflection. *result: CV_32FC1 of the area's size.
  /// Precondition: the source has more than kMaxRadius rows and columns.
  void smooth(const cv::Mat& source, const cv::Rect& area, cv::Mat* result);

 private:
  template <typename Pixel>
  void smoothPixels(const cv::Mat& source, const cv::Rect& area, cv::Mat* result);

  int radius_;
  std::array<float, kMaxRadius + 1> weights_{};  ///< by the distance from the centre
  std::vector<float> row_;                       ///< smoothed down
};

}  // namespace ground_scale_vo::direct
