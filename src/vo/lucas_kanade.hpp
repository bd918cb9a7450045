#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "vo/patch_arithmetic.hpp"

namespace ground_scale_vo {

/// Whether a patch overlaps the image; false for coordinates that are not finite.
inline bool overlaps(const cv::Mat& image, const cv::Point2f& centre, int side) {
  const float half = static_cast<float>(side / 2), width = static_cast<float>(side);
  return centre.x - half >= -width && centre.x - half < static_cast<float>(image.cols) &&
         centre.y - half >= -width && centre.y - half < static_cast<float>(image.rows);
}

/// Requests the pixels of a patch with its border from memory, so that reading them soon does not
/// wait: most of the time of tracking would be this wait.
void prefetchPatch(const cv::Mat& image, const cv::Point2f& centre, int side);

/// Memory for the tracking of patches, one after the other.
struct PatchWorkspace {
  PixelWindow window;
  PatchArray wide{};
};

/// A patch of one image that is searched in another one of the same pyramid level. Images: with a
/// border in memory, see trackingPyramid().
class PatchTemplate {
 public:
  /// False if the patch does not overlap the image, or has no texture in two directions.
  bool set(const cv::Mat& image, const cv::Point2f& centre, PatchWorkspace* workspace);

  /// Moves `point` from a guess to where the patch is found. False if it leaves the image.
  /// Precondition: set() has returned true.
  bool find(const cv::Mat& image, PatchWorkspace* workspace, cv::Point2f* point) const;

 private:
  GradientPatch patch_;
  /// For sums of gradient times difference [px / (kGreyUnit * kGradientUnit)].
  Eigen::Matrix2f inverse_hessian_;
};

/// The image and at most `levels` smaller ones, each half the size of the one before; none smaller
/// than a patch. Copies, with a border in memory.
std::vector<cv::Mat> trackingPyramid(const cv::Mat& image, int levels);

/// Pyramidal Lucas-Kanade (Bouguet 2000) of square patches: finds the displacement that minimises
/// the squared differences of grey levels. Gauss-Newton with the gradients of the first image.
/// Searches patches of one trackingPyramid() in another, one after the other.
class PyramidSearch {
 public:
  /// The arguments must outlive the object.
  PyramidSearch(const std::vector<cv::Mat>& from, const std::vector<cv::Mat>& to);

  /// Requests from memory the pixels of a patch that will soon be searched over `levels`.
  void prefetch(const cv::Point2f& from_point, const cv::Point2f& guess, int levels) const;

  /// Sets the patch to be searched, around a point of the first pyramid [px].
  void setPatch(const cv::Point2f& from_point);

  /// point: initial guess in the second pyramid [px], replaced by the result. levels: number of
  /// levels to use above the full resolution. Returns whether the patch has been found: it has
  /// texture in two directions, and overlaps the image.
  bool find(int levels, cv::Point2f* point);

 private:
  /// The patch of setPatch() in one level.
  struct LevelTemplate {
    enum { kUnknown, kUsable, kUnusable } state = kUnknown;
    PatchTemplate patch;
  };
  /// Null if the patch has no texture there or does not overlap the image.
  const PatchTemplate* templateOf(int level);

  const std::vector<cv::Mat>&from_, &to_;
  cv::Point2f from_point_;
  std::vector<LevelTemplate> templates_;
  PatchWorkspace workspace_;
};

}  // namespace ground_scale_vo
