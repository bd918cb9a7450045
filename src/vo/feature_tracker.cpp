#include "ground_scale_vo/vo/feature_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/parallel_loop.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/vo/corner_strength.hpp"
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

/// Smaller over larger eigenvalue of the gradient matrix of the patch around a pixel: 0 on a
/// straight edge, where the aperture problem leaves the position along the edge undetermined.
double eigenvalueRatio(const cv::Mat& image, const cv::Point& at, int half) {
  double xx = 0, xy = 0, yy = 0;
  for (int y = std::max(1, at.y - half); y <= std::min(image.rows - 2, at.y + half); ++y) {
    const unsigned char* above = image.ptr(y - 1);
    const unsigned char* row = image.ptr(y);
    const unsigned char* below = image.ptr(y + 1);
    for (int x = std::max(1, at.x - half); x <= std::min(image.cols - 2, at.x + half); ++x) {
      const double gx = row[x + 1] - row[x - 1], gy = below[x] - above[x];
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  const double mean = (xx + yy) / 2, radius = std::hypot((xx - yy) / 2, xy);
  return mean > 0 ? (mean - radius) / (mean + radius) : 0;
}

/// The strongest pixel of an area among those that are free (non-zero); the first of several.
/// Without a free pixel its position is negative.
struct Peak {
  cv::Point at{-1, -1};
  float strength = -1;
};
Peak strongest(const cv::Mat& strength, const cv::Mat& free) {
  Peak peak;
  for (int y = 0; y < strength.rows; ++y) {
    const float* const values = strength.ptr<float>(y);
    const unsigned char* const is_free = free.ptr(y);
    for (int x = 0; x < strength.cols; ++x) {
      if (values[x] > peak.strength && is_free[x]) peak = {{x, y}, values[x]};
    }
  }
  return peak;
}

/// Whether none of the eight neighbours is stronger.
bool isLocalMaximum(const cv::Mat& strength, const cv::Point& at) {
  const float here = strength.at<float>(at);
  for (int y = at.y - 1; y <= at.y + 1; ++y) {
    const float* const values = strength.ptr<float>(y);
    if (std::max({values[at.x - 1], values[at.x], values[at.x + 1]}) > here) return false;
  }
  return true;
}

/// With the margin that the interpolation between pixels needs.
bool isInside(const cv::Mat& image, const cv::Point2f& u) {
  return cv::Rect2f(1.f, 1.f, static_cast<float>(image.cols) - 3.f,
                    static_cast<float>(image.rows) - 3.f)
      .contains(u);
}

}  // namespace

void FeatureTracker::Options::validate() const {
  visitParameters(*this, RangeCheck("tracker/"));
  if (window_px % 2 == 0) throw OptionError("tracker/window_px must be odd");
}

FeatureTracker::FeatureTracker(const Options& options, const cv::Mat& mask)
    : options_((options.validate(), options)),
      lucas_kanade_(std::make_shared<const LucasKanade>(options_.window_px)) {
  if (mask.empty()) return;
  cv::erode(mask, allowed_, cv::Mat::ones(2 * reach() + 1, 2 * reach() + 1, CV_8U));
}

/// [px] from a corner at a whole pixel to the last pixel on which its strength or its patch, with
/// gradients, depends.
int FeatureTracker::reach() const {
  return std::max(options_.window_px / 2, CornerStrength::kReach) + 1;
}

/// Precondition: isInside() of an image.
bool FeatureTracker::isMasked(const cv::Point2f& u) const {
  return !allowed_.empty() && allowed_.at<unsigned char>(cvRound(u.y), cvRound(u.x)) == 0;
}

ImagePyramid FeatureTracker::pyramid(const cv::Mat& image) const {
  ImagePyramid result;
  result.levels = lucas_kanade_->pyramid(image, options_.pyramid_levels);
  result.image = result.levels.front();
  return result;
}

std::vector<cv::Point2f> FeatureTracker::detect(const ImagePyramid& image,
                                                const std::vector<cv::Point2f>& occupied) const {
  std::size_t level = 0;
  while (level + 1 < image.levels.size() && image.levels[level].total() > kMaxDetection_px) {
    ++level;
  }
  if (level == 0) return detectIn(image.image, allowed_, occupied);
  const auto scale = static_cast<float>(1 << level);
  cv::Mat allowed;
  if (!allowed_.empty()) {
    cv::resize(allowed_, allowed, image.levels[level].size(), 0, 0, cv::INTER_NEAREST);
  }
  std::vector<cv::Point2f> scaled = occupied;
  for (cv::Point2f& u : scaled) u /= scale;
  std::vector<cv::Point2f> corners = detectIn(image.levels[level], allowed, scaled);
  for (cv::Point2f& u : corners) u *= scale;
  return corners;
}

/// allowed: of the image's size, see allowed_.
std::vector<cv::Point2f> FeatureTracker::detectIn(const cv::Mat& image, const cv::Mat& allowed,
                                                  const std::vector<cv::Point2f>& occupied) const {
  const int cell =
      std::max(kMinCell_px, static_cast<int>(std::lround(options_.cell_size * image.cols)));
  const int border = reach();
  const int columns = (image.cols - 2 * border) / cell;
  const int rows = (image.rows - 2 * border) / cell;
  if (columns < 1 || rows < 1) return {};

  const auto cellOf = [&](const cv::Point2f& u) {
    const int column =
        static_cast<int>((u.x - static_cast<float>(border)) / static_cast<float>(cell));
    const int row = static_cast<int>((u.y - static_cast<float>(border)) / static_cast<float>(cell));
    return column >= 0 && column < columns && row >= 0 && row < rows ? row * columns + column : -1;
  };
  std::vector<unsigned char> taken(static_cast<std::size_t>(columns * rows), 0);
  cv::Mat free =
      allowed.empty() ? cv::Mat(image.size(), CV_8UC1, cv::Scalar(255)) : allowed.clone();
  for (const cv::Point2f& u : occupied) {
    const int index = cellOf(u);
    if (index >= 0) taken[static_cast<std::size_t>(index)] = 1;
    cv::circle(free, u, cell / 2, 0, cv::FILLED);
  }

  const double ratio = options_.min_corner_ratio;
  CornerStrength strength(image, border - 1);
  cv::Mat band(cell + 2, image.cols, CV_32FC1);  // a row of cells with a border of 1 px
  int filled = 0;
  std::vector<cv::Point2f> corners;
  for (int row = 0; row < rows; ++row) {
    for (; filled < band.rows; ++filled) strength.next(band.ptr<float>(filled));
    const cv::Point origin(0, border + row * cell - 1);  // upper left pixel of the band
    for (int column = 0; column < columns; ++column) {
      if (taken[static_cast<std::size_t>(row * columns + column)]) continue;
      const cv::Rect area(border + column * cell, 1, cell, cell);
      const Peak peak = strongest(band(area), free(area + origin));
      if (peak.at.x < 0 || peak.strength < options_.min_corner_strength) continue;
      cv::Point at = peak.at + area.tl();
      // A maximum on the cell's border may belong to a stronger corner in the next cell.
      if (!isLocalMaximum(band, at)) continue;
      at += origin;
      if (eigenvalueRatio(image, at, options_.window_px / 2) < ratio) continue;
      corners.emplace_back(at);
      cv::circle(free, at, cell / 2, 0, cv::FILLED);
    }
    // The last two rows are the first of the next band.
    band.rowRange(cell, cell + 2).copyTo(band.rowRange(0, 2));
    filled = 2;
  }
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
    PyramidSearch there(*lucas_kanade_, from.levels, to.levels);
    PyramidSearch back(*lucas_kanade_, to.levels, from.levels);
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
