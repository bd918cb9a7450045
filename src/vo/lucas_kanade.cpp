#include "vo/lucas_kanade.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/parallel_loop.hpp"
#include "common/vector_loop.hpp"

namespace ground_scale_vo {
namespace {

/// With more, patches on edges move along them; with fewer, those in a narrow field of view lag
/// behind.
constexpr int kMaxTrackingIterations = 20;
/// [px] step length at convergence: a fraction of a tracked corner's noise (0.7 px at a focal
/// length of 718 px).
constexpr float kTrackingConverged_px = 0.005f;
/// [px] two steps whose sum is below it in each coordinate go back and forth.
constexpr float kTrackingOscillation_px = 0.01f;
/// [grey levels^2 per px^2] least mean over the patch of the squared gradient in its weakest
/// direction.
constexpr float kMinSquaredGradient = 0.1f;

/// Pyramid levels above the full resolution when there is a prediction: it is accurate to a few
/// pixels, and one level doubles the reach of the window.
constexpr int kLevelsNearPrediction = 1;
/// [px] largest distance after tracking forward and backward; correct tracks return to 0.1 px.
constexpr double kMaxReturnError_px = 0.7;

/// Whether a patch overlaps the image; false for coordinates that are not finite.
bool overlaps(const cv::Mat& image, const cv::Point2f& centre, int side) {
  return isInside(image, centre, static_cast<float>(side / 2 - side));
}

float smallerEigenvalue(const GradientPatch& m) {
  const double difference = m.xx - m.yy, twice = 2 * m.xy;
  const auto radius = static_cast<float>(std::sqrt(difference * difference + twice * twice));
  return (m.xx + m.yy - radius) / 2;
}

// flatten: all that these call becomes part of them, and so of their version for AVX2.

GSV_VECTOR_LOOP __attribute__((flatten)) void readPatch(const cv::Mat& image,
                                                        const cv::Point2f& centre,
                                                        PixelWindow* __restrict window,
                                                        PatchArray* __restrict wide,
                                                        GradientPatch* __restrict patch) {
  const PatchCorner corner = cornerOf(centre, kTrackedSide);
  window->read(image, corner.column - 1, corner.row - 1, kTrackedSide + 3);
  window->interpolate(corner.a, corner.b, wide);
  patch->set(*wide);
}

/// Where the search ends, possibly outside of the image.
GSV_VECTOR_LOOP __attribute__((flatten)) cv::Point2f minimise(
    const GradientPatch& patch, const Eigen::Matrix2f& inverse_hessian, const cv::Mat& image,
    PixelWindow* window, cv::Point2f point) {
  cv::Point2f previous_step;
  for (int iteration = 0; iteration < kMaxTrackingIterations; ++iteration) {
    if (!overlaps(image, point, kTrackedSide)) break;
    const PatchCorner corner = cornerOf(point, kTrackedSide);
    window->read(image, corner.column, corner.row, kTrackedSide + 1);
    const Eigen::Vector2f product =
        -inverse_hessian * window->gradientTimesDifference(corner.a, corner.b, patch);
    const cv::Point2f step(product.x(), product.y());
    point += step;
    if (step.dot(step) <= kTrackingConverged_px * kTrackingConverged_px) break;
    const cv::Point2f sum = step + previous_step;
    if (iteration > 0 && std::max(std::abs(sum.x), std::abs(sum.y)) < kTrackingOscillation_px) {
      point -= step / 2;
      break;
    }
    previous_step = step;
  }
  return point;
}

/// Whether the patch of `there` is found in the second image, and from there in the first image
/// again, where it comes from. point: initial guess, replaced by the result.
bool trackThereAndBack(const cv::Point2f& from_point, int levels, PyramidSearch* there,
                       PyramidSearch* back, const cv::Mat& to, const cv::Mat& allowed,
                       cv::Point2f* point) {
  if (!there->find(levels, point) || !isInside(to, *point, 1)) return false;
  if (!allowed.empty() && allowed.at<unsigned char>(cvRound(point->y), cvRound(point->x)) == 0) {
    return false;
  }
  back->setPatch(*point);
  cv::Point2f returned = from_point;
  return back->find(0, &returned) && cv::norm(returned - from_point) <= kMaxReturnError_px;
}

}  // namespace

void prefetchPatch(const cv::Mat& image, const cv::Point2f& centre, int side) {
  if (!overlaps(image, centre, side)) return;
  const PatchCorner corner = cornerOf(centre, side);
  const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
  const unsigned char* row = image.data + (corner.row - 1) * step + corner.column - 1;
  for (int y = 0; y < side + kPatchBorder; ++y, row += step) {
    __builtin_prefetch(row);
    __builtin_prefetch(row + side + kPatchBorder - 1);
  }
}

ImagePyramid trackingPyramid(const cv::Mat& image, int levels) {
  ImagePyramid result;
  constexpr int border = kPatchStride;  // a patch outside, and its own border
  for (cv::Size size = image.size(); static_cast<int>(result.levels.size()) <= levels;
       size = {(size.width + 1) / 2, (size.height + 1) / 2}) {
    if (!result.levels.empty() && std::min(size.width, size.height) <= kTrackedSide) break;
    cv::Mat padded(size.height + 2 * border, size.width + 2 * border, CV_8UC1);
    cv::Mat level = padded({{border, border}, size});
    if (result.levels.empty()) {
      image.copyTo(level);
    } else {
      cv::pyrDown(result.levels.back(), level, size);
    }
    cv::copyMakeBorder(level, padded, border, border, border, border,
                       cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
    result.levels.push_back(level);
  }
  result.image = result.levels.front();
  return result;
}

PyramidSearch::PyramidSearch(const ImagePyramid& from, const ImagePyramid& to)
    : from_(from.levels), to_(to.levels), patches_(std::min(from_.size(), to_.size())) {}

void PyramidSearch::prefetch(const cv::Point2f& from_point, const cv::Point2f& guess,
                             int levels) const {
  for (int level = std::min(levels, static_cast<int>(patches_.size()) - 1); level >= 0; --level) {
    const auto scale = static_cast<float>(1 << level);
    prefetchPatch(from_[static_cast<std::size_t>(level)], from_point / scale, kTrackedSide);
    prefetchPatch(to_[static_cast<std::size_t>(level)], guess / scale, kTrackedSide);
  }
}

void PyramidSearch::setPatch(const cv::Point2f& from_point) {
  from_point_ = from_point;
  for (LevelPatch& level : patches_) level.state = LevelPatch::kUnknown;
}

/// Reads the patch of a level, unless it is known. Returns whether it is usable.
bool PyramidSearch::read(int level) {
  LevelPatch& at = patches_[static_cast<std::size_t>(level)];
  if (at.state != LevelPatch::kUnknown) return at.state == LevelPatch::kUsable;
  at.state = LevelPatch::kUnusable;
  const cv::Mat& image = from_[static_cast<std::size_t>(level)];
  const cv::Point2f centre = from_point_ / static_cast<float>(1 << level);
  if (!overlaps(image, centre, kTrackedSide)) return false;
  readPatch(image, centre, &window_, &wide_, &at.patch);
  constexpr float pixels = kTrackedSide * kTrackedSide;
  if (smallerEigenvalue(at.patch) <
      kMinSquaredGradient * pixels * static_cast<float>(kGradientUnit * kGradientUnit)) {
    return false;
  }
  Eigen::Matrix2f hessian;
  hessian << at.patch.xx, at.patch.xy, at.patch.xy, at.patch.yy;
  at.inverse_hessian = hessian.inverse() * (static_cast<float>(kGradientUnit) / kGreyUnit);
  at.state = LevelPatch::kUsable;
  return true;
}

bool PyramidSearch::find(int levels, cv::Point2f* point) {
  if (!read(0)) return false;  // whatever the coarser levels find
  bool found = false;
  for (int level = std::min(levels, static_cast<int>(patches_.size()) - 1); level >= 0; --level) {
    const auto k = static_cast<std::size_t>(level);
    const auto scale = static_cast<float>(1 << level);
    *point /= scale;
    found = read(level);
    if (found) {
      *point = minimise(patches_[k].patch, patches_[k].inverse_hessian, to_[k], &window_, *point);
      found = overlaps(to_[k], *point, kTrackedSide);
    }
    *point *= scale;
  }
  return found;
}

std::vector<std::optional<cv::Point2f>> trackPoints(const ImagePyramid& from,
                                                    const ImagePyramid& to,
                                                    const std::vector<cv::Point2f>& points,
                                                    const std::vector<cv::Point2f>& predicted,
                                                    const cv::Mat& allowed) {
  const std::vector<cv::Point2f>& guesses = predicted.empty() ? points : predicted;
  std::vector<std::optional<cv::Point2f>> tracks(points.size());
  parallelLoop(static_cast<int>(points.size()), [&](const cv::Range& range) {
    PyramidSearch there(from, to);
    PyramidSearch back(to, from);
    for (auto i = static_cast<std::size_t>(range.start); i < static_cast<std::size_t>(range.end);
         ++i) {
      if (i + 1 < static_cast<std::size_t>(range.end)) {
        there.prefetch(points[i + 1], guesses[i + 1], kLevelsNearPrediction);
      }
      const auto trackFrom = [&](cv::Point2f point, int levels) {
        if (trackThereAndBack(points[i], levels, &there, &back, to.image, allowed, &point)) {
          tracks[i] = point;
        }
        return tracks[i].has_value();
      };
      there.setPatch(points[i]);
      if (!predicted.empty() && trackFrom(predicted[i], kLevelsNearPrediction)) continue;
      trackFrom(points[i], kPyramidLevels);
    }
  });
  return tracks;
}

}  // namespace ground_scale_vo
