#pragma once

#include <Eigen/Core>
#include <map>
#include <opencv2/core.hpp>

#include "ground_scale_vo/input/camera.hpp"

namespace ground_scale_vo {

/// Square patches of one image at several sizes, and their normalised cross-correlation with
/// another image. "Resized" pixels are those of the other image after its reduction to a width.
class ScaledPatches {
 public:
  static constexpr int kHalf_px = 4;  ///< a patch has 2 * kHalf_px + 1 resized pixels a side
  /// Size k: the image `from` is scaled by factor() * kSizeStep^k before the patch is cut out.
  static constexpr double kSizeStep = 1.19;

  /// from, to: 8-bit grey, of the camera's size. mask: 0 where both never show the scene; empty:
  /// none. width: [px] to which `to` is reduced; not enlarged.
  ScaledPatches(const PinholeCamera& camera, const cv::Mat& from, const cv::Mat& to,
                const cv::Mat& mask, double width);

  double factor() const { return factor_; }  ///< resized over original pixels
  cv::Size size() const { return to_.size(); }
  cv::Point2f resized(const Eigen::Vector2d& u) const;
  Eigen::Vector2d original(const cv::Point2f& u) const;

  /// Whether a patch around this resized pixel touches the mask.
  bool isMasked(const cv::Point& u) const;
  /// 0 at the pixels of a region for which isMasked(); empty without a mask.
  cv::Mat allowed(const cv::Rect& region) const;

  /// Correlation in [-1, 1] of the patch around a pixel with those around the pixels of a region;
  /// float, one element per pixel. region: [resized px], reduced to the pixels where the patch
  /// fits; -1 at those of isMasked(). Empty when there are none, when the patch leaves its image,
  /// touches the mask or has no texture.
  cv::Mat correlate(const Eigen::Vector2d& u_from, int size, cv::Rect* region);

 private:
  const cv::Mat& fromAt(int size);

  const cv::Mat from_;
  const double factor_;
  const cv::Mat mask_;
  cv::Mat to_;       ///< float
  cv::Mat norm_;     ///< of the patch around each pixel of to_, without its mean
  cv::Mat allowed_;  ///< of the size of to_, 0 where a patch touches the mask; empty: no mask
  std::map<int, cv::Mat> from_at_;  ///< by size
};

}  // namespace ground_scale_vo
