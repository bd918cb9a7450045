#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "vo/feature.hpp"
#include "vo/patch_arithmetic.hpp"

namespace ground_scale_vo {

constexpr int kPyramidLevels = 4;  ///< above the full resolution

/// Requests the pixels of a patch with its border from memory, so that reading them soon does not
/// wait: most of the time of tracking would be this wait.
void prefetchPatch(const cv::Mat& image, const cv::Point2f& centre, int side);

/// The image, 8-bit grey, and at most `levels` smaller ones, each half the size of the one before;
/// none smaller than a patch. Copies, with a border in memory.
ImagePyramid trackingPyramid(const cv::Mat& image, int levels = kPyramidLevels);

/// Pyramidal Lucas-Kanade (Bouguet 2000) of square patches: finds the displacement that minimises
/// the squared differences of grey levels. Gauss-Newton with the gradients of the first image.
/// Searches patches of one trackingPyramid() in another, one after the other.
class PyramidSearch {
 public:
  /// The arguments must outlive the object.
  PyramidSearch(const ImagePyramid& from, const ImagePyramid& to);

  /// Requests from memory the pixels of a patch that will soon be searched over `levels`.
  void prefetch(const cv::Point2f& from_point, const cv::Point2f& guess, int levels) const;

  /// Sets the patch to be searched, around a point of the first pyramid [px].
  void setPatch(const cv::Point2f& from_point);

  /// point: initial guess in the second pyramid [px], replaced by the result. levels: number of
  /// levels to use above the full resolution. Returns whether the patch has been found: it has
  /// texture in two directions, and overlaps the image.
  bool find(int levels, cv::Point2f* point);

 private:
  /// The patch of setPatch() in one level. Unusable: it does not overlap the image, or has no
  /// texture in two directions.
  struct LevelPatch {
    enum { kUnknown, kUsable, kUnusable } state = kUnknown;
    GradientPatch patch;
    /// For sums of gradient times difference [px / (kGreyUnit * kGradientUnit)].
    Eigen::Matrix2f inverse_hessian;
  };
  bool read(int level);

  const std::vector<cv::Mat>&from_, &to_;
  cv::Point2f from_point_;
  std::vector<LevelPatch> patches_;
  PixelWindow window_;
  PatchArray wide_{};  ///< a patch with a border of one pixel
};

/// Where the patches around `points` [px] of one image are in the next one; empty when a patch is
/// not found, ends at a pixel where `allowed` is 0 (empty: none is), or is not found back from
/// there. predicted: initial guess of each point; empty: none. A point that is not found near its
/// guess is searched once more over all pyramid levels, starting from its position in `from`.
std::vector<std::optional<cv::Point2f>> trackPoints(const ImagePyramid& from,
                                                    const ImagePyramid& to,
                                                    const std::vector<cv::Point2f>& points,
                                                    const std::vector<cv::Point2f>& predicted,
                                                    const cv::Mat& allowed);

}  // namespace ground_scale_vo
