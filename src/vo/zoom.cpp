#include "vo/zoom.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "vo/feature.hpp"

namespace gsv {
namespace {

/// Of the points that agree with one scaling: their number, their share, and their extent in x
/// [image widths].
constexpr int kMinPoints = 25;
constexpr double kMinShare = 0.25, kMinExtent = 0.3;
/// Ratio of their depths, of the upper and the lower fifth.
constexpr double kMinDepthRatio = 2;
constexpr double kTolerance = 0.004;  ///< [image widths] of such a point
/// A smaller factor may be an error of the predicted motion.
constexpr double kMinZoom = 1.03, kMaxZoom = 3;
/// The prediction may be wrong by this rotation [rad] and shift of the centre [image widths].
constexpr double kMaxRoll = 0.05, kMaxShift = 0.08;

}  // namespace

std::optional<double> zoomBetween(const PinholeCamera& camera,
                                  const std::vector<PredictedPoint>& points) {
  std::vector<cv::Point2f> from, to;
  for (const PredictedPoint& point : points) {  // from the centre, in image widths
    const Eigen::Vector2d centre(camera.cx, camera.cy);
    from.push_back(toCv((point.predicted - centre) / camera.width));
    to.push_back(toCv((point.seen - centre) / camera.width));
  }
  if (from.size() < static_cast<std::size_t>(kMinPoints)) return std::nullopt;
  cv::Mat agrees;
  const cv::Mat A = cv::estimateAffinePartial2D(from, to, agrees, cv::RANSAC, kTolerance);
  if (A.empty()) return std::nullopt;
  const double a = A.at<double>(0, 0), b = A.at<double>(1, 0);
  const double zoom = std::hypot(a, b);
  const double shift = std::hypot(A.at<double>(0, 2), A.at<double>(1, 2));
  std::vector<double> depths;
  float left = 1, right = -1;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (agrees.at<uchar>(static_cast<int>(i)) == 0) continue;
    depths.push_back(points[i].depth);
    left = std::min(left, from[i].x);
    right = std::max(right, from[i].x);
  }
  if (depths.size() < static_cast<std::size_t>(kMinPoints)) return std::nullopt;
  std::sort(depths.begin(), depths.end());
  const double depth_ratio = depths[depths.size() * 4 / 5] / depths[depths.size() / 5];
  const double factor = std::max(zoom, 1 / zoom);
  const bool is_certain =
      static_cast<double>(depths.size()) >= kMinShare * static_cast<double>(from.size()) &&
      depth_ratio >= kMinDepthRatio && right - left >= kMinExtent &&
      std::abs(std::atan2(b, a)) <= kMaxRoll && shift <= kMaxShift && factor >= kMinZoom &&
      factor <= kMaxZoom;
  return is_certain ? std::optional(zoom) : std::nullopt;
}

}  // namespace gsv
