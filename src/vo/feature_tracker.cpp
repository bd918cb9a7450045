#include "ground_scale_vo/vo/feature_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/parallel_loop.hpp"
#include "vo/corner_detection.hpp"
#include "vo/lucas_kanade.hpp"

namespace ground_scale_vo {
namespace {

/// Pyramid levels above the full resolution when there is a prediction: it is accurate to a few
/// pixels, and one level doubles the reach of the window.
constexpr int kLevelsNearPrediction = 1;
/// [px] least side of a grid cell: corners nearer to each other share most of their patches.
constexpr int kMinCell_px = 8;
/// [px] Corners are detected in the finest level of the pyramid that has at most as many pixels: in
/// a larger one the time grows, the number of cells does not.
constexpr std::size_t kMaxDetection_px = 1'500'000;

/// With the margin that the interpolation between pixels needs.
bool isInside(const cv::Mat& image, const cv::Point2f& u) {
  return cv::Rect2f(1.f, 1.f, static_cast<float>(image.cols) - 3.f,
                    static_cast<float>(image.rows) - 3.f)
      .contains(u);
}

}  // namespace

static_assert(FeatureTracker::kPatchSide == kTrackedSide);

void FeatureTracker::Options::validate() const { visitParameters(*this, RangeCheck("tracker/")); }

FeatureTracker::FeatureTracker(const Options& options, const cv::Mat& mask)
    : options_((options.validate(), options)) {
  if (mask.empty()) return;
  cv::erode(mask, allowed_, cv::Mat::ones(2 * reach() + 1, 2 * reach() + 1, CV_8U));
}

/// [px] from a corner at a whole pixel to the last pixel on which its strength or its patch, with
/// gradients, depends.
int FeatureTracker::reach() const { return std::max(kPatchSide / 2, kCornerReach) + 1; }

/// Precondition: isInside() of an image.
bool FeatureTracker::isMasked(const cv::Point2f& u) const {
  return !allowed_.empty() && allowed_.at<unsigned char>(cvRound(u.y), cvRound(u.x)) == 0;
}

ImagePyramid FeatureTracker::pyramid(const cv::Mat& image) const {
  ImagePyramid result;
  result.levels = trackingPyramid(image, options_.pyramid_levels);
  result.image = result.levels.front();
  return result;
}

CornerCriteria FeatureTracker::criteria(int image_width) const {
  const auto cell = static_cast<int>(std::lround(options_.cell_size * image_width));
  return {std::max(kMinCell_px, cell), reach(), kPatchSide / 2, options_.min_corner_strength,
          options_.min_corner_ratio};
}

std::vector<cv::Point2f> FeatureTracker::detect(const ImagePyramid& image,
                                                const std::vector<cv::Point2f>& occupied) const {
  std::size_t level = 0;
  while (level + 1 < image.levels.size() && image.levels[level].total() > kMaxDetection_px) {
    ++level;
  }
  if (level == 0) return detectCorners(image.image, allowed_, occupied, criteria(image.image.cols));
  const auto scale = static_cast<float>(1 << level);
  cv::Mat allowed;
  if (!allowed_.empty()) {
    cv::resize(allowed_, allowed, image.levels[level].size(), 0, 0, cv::INTER_NEAREST);
  }
  std::vector<cv::Point2f> scaled = occupied;
  for (cv::Point2f& u : scaled) u /= scale;
  std::vector<cv::Point2f> corners =
      detectCorners(image.levels[level], allowed, scaled, criteria(image.levels[level].cols));
  for (cv::Point2f& u : corners) u *= scale;
  return corners;
}

/// Whether the patch of `there` is found in the second image, and from there in the first image
/// again, where it comes from. point: initial guess, replaced by the result.
bool FeatureTracker::trackThereAndBack(const cv::Point2f& from_point, int levels,
                                       PyramidSearch* there, PyramidSearch* back, const cv::Mat& to,
                                       cv::Point2f* point) const {
  if (!there->find(levels, point) || !isInside(to, *point) || isMasked(*point)) return false;
  back->setPatch(*point);
  cv::Point2f returned = from_point;
  return back->find(0, &returned) &&
         cv::norm(returned - from_point) <= options_.forward_backward_px;
}

FeatureTracker::Tracks FeatureTracker::track(const ImagePyramid& from, const ImagePyramid& to,
                                             const std::vector<cv::Point2f>& from_points,
                                             const std::vector<cv::Point2f>& predicted) const {
  const int levels = options_.pyramid_levels;
  const int levels_near_prediction = std::min(kLevelsNearPrediction, levels);
  Tracks tracks;
  tracks.points = predicted.empty() ? from_points : predicted;
  tracks.ok.assign(from_points.size(), 0);
  parallelLoop(static_cast<int>(from_points.size()), [&](const cv::Range& range) {
    PyramidSearch there(from.levels, to.levels);
    PyramidSearch back(to.levels, from.levels);
    for (auto i = static_cast<std::size_t>(range.start); i < static_cast<std::size_t>(range.end);
         ++i) {
      if (i + 1 < static_cast<std::size_t>(range.end)) {
        there.prefetch(from_points[i + 1], tracks.points[i + 1], levels_near_prediction);
      }
      cv::Point2f& point = tracks.points[i];
      there.setPatch(from_points[i]);
      bool ok = !predicted.empty() && trackThereAndBack(from_points[i], levels_near_prediction,
                                                        &there, &back, to.image, &point);
      if (!ok) {
        point = from_points[i];
        ok = trackThereAndBack(from_points[i], levels, &there, &back, to.image, &point);
      }
      tracks.ok[i] = ok;
    }
  });
  return tracks;
}

}  // namespace ground_scale_vo
