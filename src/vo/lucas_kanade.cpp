#include "vo/lucas_kanade.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/parallel_loop.hpp"

namespace ground_scale_vo {
namespace {

/// With more, patches on edges move along them; with fewer, those in a narrow field of view lag
/// behind.
constexpr int kMaxIterations = 20;
/// [px] step length at convergence: a fraction of a tracked corner's noise (0.7 px at a focal
/// length of 718 px).
constexpr float kConverged_px = 0.005f;
/// [px] two steps whose sum is below it in each coordinate go back and forth.
constexpr float kOscillation_px = 0.01f;
/// [grey levels^2 per px^2] least mean over the patch of the squared gradient in its weakest
/// direction.
constexpr float kMinSquaredGradient = 0.1f;

/// Whether a patch overlaps the image; false for coordinates that are not finite.
bool overlaps(const cv::Mat& image, const cv::Point2f& centre, int side) {
  const float half = static_cast<float>(side / 2), width = static_cast<float>(side);
  return centre.x - half >= -width && centre.x - half < static_cast<float>(image.cols) &&
         centre.y - half >= -width && centre.y - half < static_cast<float>(image.rows);
}

float smallerEigenvalue(const GradientSums& m) {
  return (m.xx + m.yy - std::hypot(m.xx - m.yy, 2 * m.xy)) / 2;
}

}  // namespace

struct LucasKanade::Workspace {
  explicit Workspace(const PatchLayout& layout) : window(layout), wide(layout), patch(layout) {}
  PixelWindow window;
  PatchArray wide;
  GradientPatch patch;
};

std::vector<cv::Mat> LucasKanade::pyramid(const cv::Mat& image, int levels) const {
  std::vector<cv::Mat> result;
  const int border = static_cast<int>(layout_.stride);  // a patch outside, and its own border
  for (cv::Size size = image.size(); static_cast<int>(result.size()) <= levels;
       size = {(size.width + 1) / 2, (size.height + 1) / 2}) {
    if (!result.empty() && std::min(size.width, size.height) <= layout_.side) break;
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

/// Moves `point` to where the patch around from_point is found. False if there is none, and the
/// point may have moved.
bool LucasKanade::trackLevel(const cv::Mat& from, const cv::Mat& to, const cv::Point2f& from_point,
                             Workspace* workspace, cv::Point2f* point) const {
  if (!overlaps(from, from_point, layout_.side)) return false;
  PixelWindow& window = workspace->window;
  const PatchCorner origin = cornerOf({from_point.x, from_point.y}, layout_);
  window.read(from, origin.column - 1, origin.row - 1, layout_.side + 3);
  window.interpolate(origin.a, origin.b, &workspace->wide);
  const GradientSums sum = workspace->patch.set(workspace->wide);
  const float pixels = static_cast<float>(layout_.side * layout_.side);
  if (smallerEigenvalue(sum) <
      kMinSquaredGradient * pixels * static_cast<float>(kGradientUnit * kGradientUnit)) {
    return false;
  }
  Eigen::Matrix2f hessian;
  hessian << sum.xx, sum.xy, sum.xy, sum.yy;
  const Eigen::Matrix2f inverse_hessian =
      hessian.inverse() * (static_cast<float>(kGradientUnit) / kGreyUnit);
  Eigen::Vector2f previous_step = Eigen::Vector2f::Zero();
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!overlaps(to, *point, layout_.side)) return false;
    const PatchCorner corner = cornerOf({point->x, point->y}, layout_);
    window.read(to, corner.column, corner.row, layout_.side + 1);
    const Eigen::Vector2f step =
        -inverse_hessian * window.gradientTimesDifference(corner.a, corner.b, workspace->patch);
    *point += cv::Point2f(step.x(), step.y());
    if (step.squaredNorm() <= kConverged_px * kConverged_px) break;
    if (iteration > 0 && (step + previous_step).cwiseAbs().maxCoeff() < kOscillation_px) {
      *point -= cv::Point2f(step.x(), step.y()) / 2;
      break;
    }
    previous_step = step;
  }
  return overlaps(to, *point, layout_.side);
}

std::vector<unsigned char> LucasKanade::track(const std::vector<cv::Mat>& from,
                                              const std::vector<cv::Mat>& to,
                                              const std::vector<cv::Point2f>& from_points,
                                              int levels, std::vector<cv::Point2f>* points) const {
  const int top = std::min(levels, static_cast<int>(std::min(from.size(), to.size())) - 1);
  std::vector<unsigned char> found(from_points.size(), 0);
  parallelLoop(static_cast<int>(from_points.size()), [&](const cv::Range& range) {
    Workspace workspace(layout_);
    for (auto i = static_cast<std::size_t>(range.start); i < static_cast<std::size_t>(range.end);
         ++i) {
      cv::Point2f& point = (*points)[i];
      for (int level = top; level >= 0; --level) {
        const auto k = static_cast<std::size_t>(level);
        const auto scale = static_cast<float>(1 << level);
        point /= scale;
        found[i] = trackLevel(from[k], to[k], from_points[i] / scale, &workspace, &point);
        point *= scale;
      }
    }
  });
  return found;
}

}  // namespace ground_scale_vo
