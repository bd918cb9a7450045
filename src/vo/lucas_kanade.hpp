#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "vo/patch_arithmetic.hpp"

namespace ground_scale_vo {

/// Pyramidal Lucas-Kanade (Bouguet 2000) of square patches: finds the displacement that minimises
/// the squared differences of grey levels. Gauss-Newton with the gradients of the first image.
class LucasKanade {
 public:
  /// window_px: side of the patches, odd, at most kMaxPatchSide.
  explicit LucasKanade(int window_px) : layout_(window_px) {}

  /// The image and at most `levels` smaller ones, each half the size of the one before; none
  /// smaller than a patch. Copies, with a border in memory.
  std::vector<cv::Mat> pyramid(const cv::Mat& image, int levels) const;

  /// Tracks points [px] from one pyramid to another, both made by pyramid() of an object with the
  /// same window_px, on which their border in memory depends. points: their initial guesses,
  /// replaced by the results. levels: number of levels to use above the full resolution. Returns
  /// for each point whether it has been found: its patch has texture in two directions, and
  /// overlaps the image.
  std::vector<unsigned char> track(const std::vector<cv::Mat>& from, const std::vector<cv::Mat>& to,
                                   const std::vector<cv::Point2f>& from_points, int levels,
                                   std::vector<cv::Point2f>* points) const;

 private:
  struct Workspace;
  bool trackLevel(const cv::Mat& from, const cv::Mat& to, const cv::Point2f& from_point,
                  Workspace* workspace, cv::Point2f* point) const;

  PatchLayout layout_;
};

}  // namespace ground_scale_vo
