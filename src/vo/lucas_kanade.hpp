#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "vo/patch_tracking.hpp"

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

  const PatchLayout& layout() const { return layout_; }

 private:
  PatchLayout layout_;
};

/// Searches patches of one pyramid in another, one after the other. Both pyramids are made by
/// LucasKanade::pyramid() with the same window_px, on which their border in memory depends.
class PyramidSearch {
 public:
  /// The arguments must outlive the object.
  PyramidSearch(const LucasKanade& lucas_kanade, const std::vector<cv::Mat>& from,
                const std::vector<cv::Mat>& to);

  /// Requests from memory the pixels of a patch that will soon be searched over `levels`.
  void prefetch(const cv::Point2f& from_point, const cv::Point2f& guess, int levels) const;

  /// Sets the patch to be searched, around a point of the first pyramid [px].
  void setPatch(const cv::Point2f& from_point);

  /// point: initial guess in the second pyramid [px], replaced by the result. levels: number of
  /// levels to use above the full resolution. Returns whether the patch has been found: it has
  /// texture in two directions, and overlaps the image.
  bool find(int levels, cv::Point2f* point);

 private:
  /// Of setPatch(), in one level.
  struct LevelTemplate {
    enum { kUnknown, kUsable, kUnusable } state = kUnknown;
    PatchTemplate patch;
  };
  /// Null if the patch has no texture there or does not overlap the image.
  const PatchTemplate* templateOf(int level);

  const PatchLayout& layout_;
  const std::vector<cv::Mat>&from_, &to_;
  cv::Point2f from_point_;
  std::vector<LevelTemplate> templates_;
  PatchWorkspace workspace_;
};

}  // namespace ground_scale_vo
