#include "vo/scaled_patches.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {
namespace {

constexpr int kSide_px = 2 * ScaledPatches::kHalf_px + 1;

/// [grey levels] least standard deviation of a patch; sensor noise has about 1 to 2.
constexpr double kMinDeviation = 2;

cv::Point2f scaled(const Eigen::Vector2d& u, double scale) {
  return {static_cast<float>((u.x() + 0.5) * scale - 0.5),
          static_cast<float>((u.y() + 0.5) * scale - 0.5)};
}

}  // namespace

ScaledPatches::ScaledPatches(const PinholeCamera& camera, const cv::Mat& from, const cv::Mat& to,
                             double width)
    : from_(from), factor_(std::min(1.0, width / camera.width)) {
  cv::resize(to, to_, {}, factor_, factor_, cv::INTER_AREA);
}

cv::Point2f ScaledPatches::resized(const Eigen::Vector2d& u) const { return scaled(u, factor_); }

Eigen::Vector2d ScaledPatches::original(const cv::Point2f& u) const {
  return {(u.x + 0.5) / factor_ - 0.5, (u.y + 0.5) / factor_ - 0.5};
}

cv::Mat ScaledPatches::correlate(const Eigen::Vector2d& u_from, int size, cv::Rect* region) {
  const cv::Mat& source = fromAt(size);
  const cv::Point2f centre = scaled(u_from, factor_ * std::pow(kSizeStep, size));
  const bool inside = centre.x >= kHalf_px && centre.y >= kHalf_px &&
                      centre.x < static_cast<float>(source.cols - kHalf_px - 1) &&
                      centre.y < static_cast<float>(source.rows - kHalf_px - 1);
  *region &= cv::Rect(kHalf_px, kHalf_px, to_.cols - kSide_px + 1, to_.rows - kSide_px + 1);
  if (!inside || region->empty()) return {};
  cv::Mat patch, correlation;
  cv::getRectSubPix(source, {kSide_px, kSide_px}, centre, patch);
  cv::Scalar mean, deviation;
  cv::meanStdDev(patch, mean, deviation);
  if (deviation[0] < kMinDeviation) return {};
  const cv::Rect pixels(region->x - kHalf_px, region->y - kHalf_px, region->width + kSide_px - 1,
                        region->height + kSide_px - 1);
  cv::matchTemplate(to_(pixels), patch, correlation, cv::TM_CCOEFF_NORMED);
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
