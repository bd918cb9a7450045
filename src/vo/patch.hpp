#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

/// A square patch of an image with its gradients, which is searched in other images with subpixel
/// accuracy: Gauss-Newton with the gradients of the patch (inverse-compositional, Baker & Matthews
/// 2004), zero-mean squared differences of grey levels.
///
/// Grey levels and gradients are 16-bit integers. They are stored row by row in flat arrays with
/// kStride elements a row; the loops run over an array without regard to rows, so that the compiler
/// vectorises them. Sums of products are exact integers: the results do not depend on the
/// instruction set.
class Patch {
 public:
  static constexpr int kSide = 9;  ///< [px] a small patch tolerates more change of size
  /// [px] that an image has in memory around it for cut() and find() (see withBorder()): they read
  /// patches that are partly outside of the image.
  static constexpr int kBorder = kSide + 3;

  Patch() {}  // leaves the arrays uninitialised: cut() writes what is read

  /// Copies the patch around a point [px]. False if it does not overlap the image, or has no
  /// texture in two directions; then it cannot be searched.
  bool cut(const cv::Mat& image, const cv::Point2f& centre);

  /// The same with the pixels at centre + step * (x, y). False also if they are not all inside the
  /// image, which needs no border.
  bool cut(const cv::Mat& image, const cv::Point2f& centre, const Eigen::Matrix2f& step);

  /// Moves `point` from a guess to where the patch is found. False if it leaves the image, or goes
  /// farther than max_distance [px] from the guess.
  bool find(const cv::Mat& image, float max_distance, cv::Point2f* point) const;

  /// Normalised cross-correlation with the patch of an image around a point, in [-1, 1].
  /// Precondition: find() has returned true for the point.
  float correlation(const cv::Mat& image, const cv::Point2f& point) const;

  /// Requests the pixels of a patch from memory, so that reading them soon does not wait: most of
  /// the time of tracking would be this wait.
  static void prefetch(const cv::Mat& image, const cv::Point2f& centre);

  static constexpr std::size_t kStride = kSide + 3;  ///< gradients and interpolation need 3 px more
  static constexpr std::size_t kChunk = 16;          ///< the loops process whole ones
  /// Of a patch with its border, and what loops access beyond it.
  using Array = std::array<std::int16_t, kStride * kStride + 2 * kChunk>;

 private:
  bool prepareSearch(const Array& wide);

  Array grey_, gradient_x_, gradient_y_;
  Eigen::Vector2f mean_gradient_;
  Eigen::Matrix2f inverse_hessian_;  ///< [px] per sum of gradient times difference
};

/// A copy of the image that has its reflection in Patch::kBorder pixels of memory around it.
cv::Mat withBorder(const cv::Mat& image);

}  // namespace ground_scale_vo
