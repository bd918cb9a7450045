#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/common/options.hpp"

namespace ground_scale_vo {

/// An image with its Gaussian pyramid and gradients, made once and used for tracking from and to
/// it.
struct ImagePyramid {
  cv::Mat image;                ///< 8-bit grey, level 0, own memory
  std::vector<cv::Mat> levels;  ///< as cv::buildOpticalFlowPyramid makes it
  double exposure = 1;          ///< over that of another image: whose, is up to its user
};

/// Corners spread over the image, and pyramidal Lucas-Kanade with a forward-backward check.
/// Lengths are fractions of the image width, so nothing depends on one camera's resolution.
class FeatureTracker {
 public:
  struct Options {
    double cell = 0.0129;
    double min_corner_strength = 1e-4;
    double min_corner_ratio = 0.12;
    int window_px = 9;
    int pyramid_levels = 4;
    double forward_backward_px = 0.7;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("cell", self.cell, 0.004, 0.2,
            "[image width] side of the square that holds one corner");
      visit("min_corner_strength", self.min_corner_strength, 0, 1,
            "[] smaller eigenvalue of the gradient matrix, image in [0, 1]");
      visit("min_corner_ratio", self.min_corner_ratio, 0, 1,
            "[] smaller over larger eigenvalue over the patch; below it the patch is an edge");
      visit("window_px", self.window_px, 5, 51,
            "[px] side of the tracked patch, odd; a small one suffers less from change of scale");
      visit("pyramid_levels", self.pyramid_levels, 0, 8, "[levels] above the full image");
      visit("forward_backward_px", self.forward_backward_px, 0.05, 10,
            "[px] largest distance after tracking there and back");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit FeatureTracker(const Options& options);

  ImagePyramid pyramid(const cv::Mat& image) const;

  /// New corners in the cells that hold none of `occupied`, strongest of its cell each.
  std::vector<cv::Point2f> detect(const cv::Mat& image,
                                  const std::vector<cv::Point2f>& occupied) const;

  struct Tracks {
    std::vector<cv::Point2f> points;  ///< same order as `from_points`; meaningful where ok
    std::vector<unsigned char> ok;
  };

  /// predicted: a first guess of each point in `to`, same length as from_points. A point that is
  /// not found near its guess is searched once more from its place in `from`, over all levels.
  Tracks track(const ImagePyramid& from, const ImagePyramid& to,
               const std::vector<cv::Point2f>& from_points,
               const std::vector<cv::Point2f>& predicted) const;

 private:
  Tracks trackOnce(const ImagePyramid& from, const ImagePyramid& to,
                   const std::vector<cv::Point2f>& from_points,
                   const std::vector<cv::Point2f>& predicted, int levels) const;

  Options options_;
};

}  // namespace ground_scale_vo
