#include "vo/lucas_kanade.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

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

float smallerEigenvalue(const GradientSums& m) {
  const double difference = m.xx - m.yy, twice = 2 * m.xy;
  const auto radius = static_cast<float>(std::sqrt(difference * difference + twice * twice));
  return (m.xx + m.yy - radius) / 2;
}

// flatten: all that these call becomes part of them, and so of their version for AVX2.

GSV_VECTOR_LOOP __attribute__((flatten)) GradientSums readTemplate(
    const cv::Mat& image, const cv::Point2f& centre, PatchWorkspace* __restrict workspace,
    GradientPatch* __restrict patch) {
  const PatchCorner corner = cornerOf(centre, kTrackedSide);
  workspace->window.read(image, corner.column - 1, corner.row - 1, kTrackedSide + 3);
  workspace->window.interpolate(corner.a, corner.b, &workspace->wide);
  return patch->set(workspace->wide);
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

bool PatchTemplate::set(const cv::Mat& image, const cv::Point2f& centre,
                        PatchWorkspace* workspace) {
  if (!overlaps(image, centre, kTrackedSide)) return false;
  const GradientSums sum = readTemplate(image, centre, workspace, &patch_);
  constexpr float pixels = kTrackedSide * kTrackedSide;
  if (smallerEigenvalue(sum) <
      kMinSquaredGradient * pixels * static_cast<float>(kGradientUnit * kGradientUnit)) {
    return false;
  }
  Eigen::Matrix2f hessian;
  hessian << sum.xx, sum.xy, sum.xy, sum.yy;
  inverse_hessian_ = hessian.inverse() * (static_cast<float>(kGradientUnit) / kGreyUnit);
  return true;
}

bool PatchTemplate::find(const cv::Mat& image, PatchWorkspace* workspace,
                         cv::Point2f* point) const {
  *point = minimise(patch_, inverse_hessian_, image, &workspace->window, *point);
  return overlaps(image, *point, kTrackedSide);
}

std::vector<cv::Mat> trackingPyramid(const cv::Mat& image, int levels) {
  std::vector<cv::Mat> result;
  constexpr int border = kPatchStride;  // a patch outside, and its own border
  for (cv::Size size = image.size(); static_cast<int>(result.size()) <= levels;
       size = {(size.width + 1) / 2, (size.height + 1) / 2}) {
    if (!result.empty() && std::min(size.width, size.height) <= kTrackedSide) break;
    cv::Mat padded(size.height + 2 * border, size.width + 2 * border, CV_8UC1);
    cv::Mat level = padded({{border, border}, size});
    if (result.empty()) {
      image.copyTo(level);
    } else {
      cv::pyrDown(result.back(), level, size);
    }
    cv::copyMakeBorder(level, padded, border, border, border, border,
                       cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
    result.push_back(level);
  }
  return result;
}

PyramidSearch::PyramidSearch(const std::vector<cv::Mat>& from, const std::vector<cv::Mat>& to)
    : from_(from), to_(to), templates_(std::min(from.size(), to.size())) {}

void PyramidSearch::prefetch(const cv::Point2f& from_point, const cv::Point2f& guess,
                             int levels) const {
  for (int level = std::min(levels, static_cast<int>(templates_.size()) - 1); level >= 0; --level) {
    const auto scale = static_cast<float>(1 << level);
    prefetchPatch(from_[static_cast<std::size_t>(level)], from_point / scale, kTrackedSide);
    prefetchPatch(to_[static_cast<std::size_t>(level)], guess / scale, kTrackedSide);
  }
}

void PyramidSearch::setPatch(const cv::Point2f& from_point) {
  from_point_ = from_point;
  for (LevelTemplate& level : templates_) level.state = LevelTemplate::kUnknown;
}

const PatchTemplate* PyramidSearch::templateOf(int level) {
  const auto k = static_cast<std::size_t>(level);
  LevelTemplate& result = templates_[k];
  if (result.state == LevelTemplate::kUnknown) {
    const cv::Point2f centre = from_point_ / static_cast<float>(1 << level);
    result.state = result.patch.set(from_[k], centre, &workspace_) ? LevelTemplate::kUsable
                                                                   : LevelTemplate::kUnusable;
  }
  return result.state == LevelTemplate::kUsable ? &result.patch : nullptr;
}

bool PyramidSearch::find(int levels, cv::Point2f* point) {
  if (!templateOf(0)) return false;  // whatever the coarser levels find
  bool found = false;
  for (int level = std::min(levels, static_cast<int>(templates_.size()) - 1); level >= 0; --level) {
    const PatchTemplate* const patch = templateOf(level);
    const auto scale = static_cast<float>(1 << level);
    *point /= scale;
    found = patch && patch->find(to_[static_cast<std::size_t>(level)], &workspace_, point);
    *point *= scale;
  }
  return found;
}

}  // namespace ground_scale_vo
