#include "vo/scaled_patches.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "vo/masked_patch.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kSide_px = 2 * ScaledPatches::kHalf_px + 1;

/// [grey levels] least standard deviation of a patch; sensor noise has about 1 to 2.
constexpr double kMinDeviation = 2;

/// Least sum of the squared differences from the mean of a patch. That of integers is zero or more
/// than this; the correlation with a patch of zero becomes about zero.
constexpr double kMinSquaredNorm = 0.5;

cv::Point2f scaled(const Eigen::Vector2d& u, double scale) {
  return {static_cast<float>((u.x() + 0.5) * scale - 0.5),
          static_cast<float>((u.y() + 0.5) * scale - 0.5)};
}

}  // namespace

ScaledPatches::ScaledPatches(const PinholeCamera& camera, const cv::Mat& from, const cv::Mat& to,
                             const cv::Mat& mask, double width)
    : from_(from), factor_(std::min(1.0, width / camera.width)), mask_(mask) {
  cv::Mat resized, mean, mean_square;
  cv::resize(to, resized, {}, factor_, factor_, cv::INTER_AREA);
  resized.convertTo(to_, CV_32F);
  cv::boxFilter(resized, mean, CV_64F, {kSide_px, kSide_px});
  cv::sqrBoxFilter(resized, mean_square, CV_64F, {kSide_px, kSide_px});
  cv::Mat norm;
  cv::sqrt(cv::max((mean_square - mean.mul(mean)) * kSide_px * kSide_px, kMinSquaredNorm), norm);
  norm.convertTo(norm_, CV_32F);
  if (mask.empty()) return;
  cv::resize(mask != 0, allowed_, to_.size(), 0, 0, cv::INTER_AREA);
  cv::erode(allowed_ == 255, allowed_, cv::Mat::ones(kSide_px, kSide_px, CV_8U));
}

bool ScaledPatches::isMasked(const cv::Point& u) const {
  return !allowed_.empty() && allowed_.at<unsigned char>(u) == 0;
}

cv::Mat ScaledPatches::allowed(const cv::Rect& region) const {
  return allowed_.empty() ? cv::Mat() : allowed_(region);
}

cv::Point2f ScaledPatches::resized(const Eigen::Vector2d& u) const { return scaled(u, factor_); }

Eigen::Vector2d ScaledPatches::original(const cv::Point2f& u) const {
  return {(u.x + 0.5) / factor_ - 0.5, (u.y + 0.5) / factor_ - 0.5};
}

cv::Mat ScaledPatches::correlate(const Eigen::Vector2d& u_from, int size, cv::Rect* region) {
  const cv::Mat& source = fromAt(size);
  const double scale = factor_ * std::pow(kSizeStep, size);
  const cv::Point2f centre = scaled(u_from, scale);
  const bool inside = centre.x >= kHalf_px && centre.y >= kHalf_px &&
                      centre.x < static_cast<float>(source.cols - kHalf_px - 1) &&
                      centre.y < static_cast<float>(source.rows - kHalf_px - 1);
  *region &= cv::Rect(kHalf_px, kHalf_px, to_.cols - kSide_px + 1, to_.rows - kSide_px + 1);
  if (!inside || region->empty()) return {};
  const cv::Point2f pixel(static_cast<float>(u_from.x()), static_cast<float>(u_from.y()));
  // With half a pixel of the resized image, and one for the interpolation.
  if (touchesMask(mask_, pixel, static_cast<int>(std::ceil((kHalf_px + 1.5) / scale)) + 1)) {
    return {};
  }
  cv::Mat patch, correlation;
  cv::getRectSubPix(source, {kSide_px, kSide_px}, centre, patch);
  cv::Scalar mean, deviation;
  cv::meanStdDev(patch, mean, deviation);
  if (deviation[0] < kMinDeviation) return {};
  patch.convertTo(patch, CV_32F, 1 / (kSide_px * deviation[0]),
                  -mean[0] / (kSide_px * deviation[0]));
  cv::filter2D(to_(*region), correlation, CV_32F, patch);  // also reads around the region
  cv::divide(correlation, norm_(*region), correlation);
  if (!mask_.empty()) correlation.setTo(-1, allowed(*region) == 0);
  return correlation;
}

const cv::Mat& ScaledPatches::fromAt(int size) {
  cv::Mat& result = from_at_[size];
  if (result.empty()) {
    const double scale = factor_ * std::pow(kSizeStep, size);
    cv::resize(from_, result, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  }
  return result;
}

}  // namespace ground_scale_vo
