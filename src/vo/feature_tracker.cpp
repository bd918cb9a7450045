#include "ground_scale_vo/vo/feature_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "common/parallel_loop.hpp"
#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/vo/corner_strength.hpp"
#include "vo/free_pixels.hpp"
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
/// Instead of the strength of a pixel that is not free; less than any strength.
constexpr float kNotFree = -1;

/// Smaller over larger eigenvalue of the gradient matrix of the patch around a pixel: 0 on a
/// straight edge, where the aperture problem leaves the position along the edge undetermined.
double eigenvalueRatio(const cv::Mat& image, const cv::Point& at, int half) {
  int xx = 0, xy = 0, yy = 0;  // at most 51 x 51 squares of 255
  for (int y = std::max(1, at.y - half); y <= std::min(image.rows - 2, at.y + half); ++y) {
    const unsigned char* above = image.ptr(y - 1);
    const unsigned char* row = image.ptr(y);
    const unsigned char* below = image.ptr(y + 1);
    for (int x = std::max(1, at.x - half); x <= std::min(image.cols - 2, at.x + half); ++x) {
      const int gx = row[x + 1] - row[x - 1], gy = below[x] - above[x];
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  const double mean = 0.5 * (xx + yy), radius = std::hypot(0.5 * (xx - yy), xy);
  return mean > 0 ? (mean - radius) / (mean + radius) : 0;
}

/// Largest strength among the free (non-zero) pixels of each column of an area; kNotFree without
/// one. Strides: between rows.
GSV_VECTOR_LOOP void columnMaxima(const float* __restrict strength, std::size_t strength_stride,
                                  const unsigned char* __restrict free, std::size_t free_stride,
                                  int columns, int rows, float* __restrict maxima) {
  for (int x = 0; x < columns; ++x) maxima[x] = kNotFree;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const float value = free[x] ? strength[x] : kNotFree;
      maxima[x] = value > maxima[x] ? value : maxima[x];
    }
    strength += strength_stride;
    free += free_stride;
  }
}

/// The strongest pixel of an area among those that are free (non-zero), if its strength is at least
/// `least`; the first of several. strength, free: of the same pixels. maxima: memory for a row.
std::optional<cv::Point> strongest(const cv::Mat& strength, const cv::Mat& free,
                                   const cv::Rect& area, double least, std::vector<float>* maxima) {
  maxima->resize(static_cast<std::size_t>(area.width));
  columnMaxima(strength.ptr<float>(area.y) + area.x, strength.step1(), free.ptr(area.y) + area.x,
               free.step1(), area.width, area.height, maxima->data());
  const float largest = *std::max_element(maxima->begin(), maxima->end());
  if (!(largest > kNotFree) || largest < least) return std::nullopt;
  cv::Point first = area.br();
  for (int x = area.x; x < area.br().x; ++x) {
    if ((*maxima)[static_cast<std::size_t>(x - area.x)] < largest) continue;
    int y = area.y;
    while (strength.at<float>(y, x) < largest || free.at<unsigned char>(y, x) == 0) ++y;
    if (y < first.y) first = {x, y};
  }
  return first;
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
  FreePixels free(image.size(), allowed, cell / 2);
  for (const cv::Point2f& u : occupied) {
    const int index = cellOf(u);
    if (index >= 0) taken[static_cast<std::size_t>(index)] = 1;
    free.removeDisc(u);
  }

  const double ratio = options_.min_corner_ratio;
  CornerStrength strength(image, border - 1);
  cv::Mat band(cell + 2, image.cols, CV_32FC1);  // a row of cells with a border of 1 px
  int filled = 0;
  std::vector<float> maxima;
  std::vector<cv::Point2f> corners;
  for (int row = 0; row < rows; ++row) {
    for (; filled < band.rows; ++filled) strength.next(band.ptr<float>(filled));
    const int first_row = border + row * cell - 1;
    const cv::Mat free_band = free.mask().rowRange(first_row, first_row + band.rows);
    for (int column = 0; column < columns; ++column) {
      if (taken[static_cast<std::size_t>(row * columns + column)]) continue;
      const cv::Rect area(border + column * cell, 1, cell, cell);
      const std::optional<cv::Point> peak =
          strongest(band, free_band, area, options_.min_corner_strength, &maxima);
      // A maximum on the cell's border may belong to a stronger corner in the next cell.
      if (!peak || !isLocalMaximum(band, *peak)) continue;
      const cv::Point at = *peak + cv::Point(0, first_row);
      if (eigenvalueRatio(image, at, options_.window_px / 2) < ratio) continue;
      corners.emplace_back(at);
      free.removeDisc(at);
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
