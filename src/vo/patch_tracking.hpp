#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

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
/// border in memory, see LucasKanade::pyramid().
class PatchTemplate {
 public:
  /// False if the patch does not overlap the image, or has no texture in two directions.
  bool set(const PatchLayout& layout, const cv::Mat& image, const cv::Point2f& centre,
           PatchWorkspace* workspace);

  /// Moves `point` from a guess to where the patch is found. False if it leaves the image.
  /// Precondition: set() has returned true.
  bool find(const PatchLayout& layout, const cv::Mat& image, PatchWorkspace* workspace,
            cv::Point2f* point) const;

 private:
  GradientPatch patch_;
  /// Of the sums of gradient times difference [px / (kGreyUnit * kGradientUnit)].
  Eigen::Matrix2f inverse_hessian_;
};

}  // namespace ground_scale_vo
