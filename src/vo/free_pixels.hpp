#pragma once

#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// The pixels of an image at which a corner may be detected: the allowed ones without discs around
/// the features and the corners so far. Hundreds of discs are removed, and cv::circle() takes three
/// times as long: this copies their pixels from a template, and a margin in memory makes clipping
/// unnecessary.
class FreePixels {
 public:
  /// allowed: 8-bit, of the image's size, 0 at pixels that are not free; empty: all are free.
  /// radius: of the discs [px].
  FreePixels(const cv::Size& size, const cv::Mat& allowed, int radius);

  /// The same pixels as those of a filled cv::circle(). Its centre may be outside the image.
  void removeDisc(const cv::Point& centre);

  /// 8-bit, of the image's size, 0 at pixels that are not free.
  const cv::Mat& mask() const { return mask_; }

 private:
  int radius_;
  cv::Mat disc_;    ///< 0 in the disc, 255 around it
  cv::Mat padded_;  ///< the mask with its margin
  cv::Mat mask_;    ///< part of padded_
};

}  // namespace ground_scale_vo
