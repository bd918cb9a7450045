#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/common/options.hpp"

namespace ground_scale_vo {

class PyramidSearch;
struct CornerCriteria;

/// An image with its Gaussian pyramid, computed once for tracking to it and from it.
struct ImagePyramid {
  cv::Mat image;                ///< 8-bit grey, level 0, own memory
  std::vector<cv::Mat> levels;  ///< each half the size of the one before, with a border in memory
  double exposure = 1;          ///< relative to an image that the caller chooses
};

/// Shi-Tomasi corners, one per grid cell, and pyramidal Lucas-Kanade with a forward-backward check.
/// The cell size is a fraction of the image width, so the number of features does not depend on the
/// camera's resolution, unless a cell would be smaller than 8 px.
class FeatureTracker {
 public:
  /// [px] Side of the tracked patches: a small patch tolerates more change of size.
  static constexpr int kPatchSide = 9;

  struct Options {
    double cell_size = 0.0129;
    double min_corner_strength = 1e-4;
    double min_corner_ratio = 0.12;
    int pyramid_levels = 4;
    double forward_backward_px = 0.7;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit(
          "cell_size", self.cell_size, 0.004, 0.2,
          "[image width] side of the grid cells, at least 8 px; each holds at most one new corner");
      visit("min_corner_strength", self.min_corner_strength, 0, 1,
            "[] smaller eigenvalue of the gradient matrix, grey levels in [0, 1]");
      visit("min_corner_ratio", self.min_corner_ratio, 0, 1,
            "[] smaller over larger eigenvalue; a corner with less lies on an edge");
      visit("pyramid_levels", self.pyramid_levels, 0, 8, "[levels] above the full resolution");
      visit("forward_backward_px", self.forward_backward_px, 0.05, 10,
            "[px] largest distance after tracking forward and backward");
    }
    /// Throws OptionError.
    void validate() const;
  };

  /// mask: 8-bit, one channel, of the images' size, 0 where they never show the scene; empty: none.
  /// No corner is detected, and none tracked to a place, where its patch at full resolution would
  /// contain such a pixel.
  explicit FeatureTracker(const Options& options, const cv::Mat& mask = {});

  /// image: 8-bit grey. Copied.
  ImagePyramid pyramid(const cv::Mat& image) const;

  /// The strongest corner of each cell that holds none of `occupied` [px]; at most one per cell. Of
  /// a large image, in a coarser level of its pyramid.
  std::vector<cv::Point2f> detect(const ImagePyramid& image,
                                  const std::vector<cv::Point2f>& occupied) const;

  struct Tracks {
    std::vector<cv::Point2f> points;  ///< [px] in the order of `from_points`; valid where ok
    std::vector<unsigned char> ok;    ///< found, in the image, not at the mask, check passed
  };

  /// from, to: of this tracker's pyramid(). predicted: initial guess of each point in `to` [px],
  /// same length as from_points; empty: none. A point that is not found near its guess is searched
  /// once more over all pyramid levels, starting from its position in `from`.
  Tracks track(const ImagePyramid& from, const ImagePyramid& to,
               const std::vector<cv::Point2f>& from_points,
               const std::vector<cv::Point2f>& predicted) const;

 private:
  bool trackThereAndBack(const cv::Point2f& from_point, int levels, PyramidSearch* there,
                         PyramidSearch* back, const cv::Mat& to, cv::Point2f* point) const;
  CornerCriteria criteria(int image_width) const;
  int reach() const;
  bool isMasked(const cv::Point2f& u) const;

  Options options_;
  cv::Mat allowed_;  ///< 0 at the pixels whose patch touches the mask; empty: no mask
};

}  // namespace ground_scale_vo
