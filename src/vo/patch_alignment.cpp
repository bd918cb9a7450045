#include "ground_scale_vo/vo/patch_alignment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kMaxWindow = 21;
constexpr int kMaxAlignmentIterations = 10;  // of Gauss-Newton
/// [px] step of the numeric derivative of the warp: small against a patch, large against rounding.
constexpr double kWarpStep_px = 2;
/// [px] step length at convergence: far below the noise of an aligned corner (0.2 px).
constexpr float kConverged_px = 0.003f;
/// While iterating, a patch may be this many times max_shift_px from its start.
constexpr float kMaxIntermediateShift = 2;
/// Minimum determinant over squared trace of the gradient matrix: the ratio of its eigenvalues is
/// then at least about 1e-3. Below this value the patch is an edge.
constexpr float kMinCornerness = 1e-3f;
/// [grey levels^2] guards the division by the sum of squared deviations from the mean of a uniform
/// patch in the current image.
constexpr float kMinSumOfSquares = 1e-3f;
/// Least ratio of the areas of a patch in the two images, and the inverse of the largest.
constexpr double kMinAreaRatio = 0.1;
/// Sine of the minimum angle between the line of sight and the surface (1.1 degrees). Below it the
/// surface is edge-on and the warp is undetermined.
constexpr double kMinGrazingSine = 0.02;

// A patch is stored row by row in a flat array with a stride of the window plus two columns. The
// loops run over the array without regard to rows, kLanes pixels at a time, and a mask removes the
// padding.
constexpr std::size_t kLanes = 8;
constexpr std::size_t kMaxStride = kMaxWindow + 2;
using Patch = std::array<float, kMaxStride * kMaxStride + kLanes>;

/// kLanes numbers anywhere in memory. A vector type of the compiler, because it does not vectorise
/// the equivalent loops reliably.
typedef float Lanes
    __attribute__((vector_size(kLanes * sizeof(float)), aligned(alignof(float)), may_alias));

const Lanes& lanes(const float* at) { return *reinterpret_cast<const Lanes*>(at); }
Lanes& lanes(float* at) { return *reinterpret_cast<Lanes*>(at); }

float total(const Lanes& sum) {
  return ((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]));
}

/// Whether the square of half side `margin` [px] around u lies inside the image, with the
/// neighbours that bilinear interpolation needs.
bool contains(const cv::Mat& image, const Eigen::Vector2f& u, float margin) {
  return u.x() >= margin && u.y() >= margin &&
         u.x() + margin < static_cast<float>(image.cols - 1) &&
         u.y() + margin < static_cast<float>(image.rows - 1);
}

/// Interpolates the image at u_ref + step * (x, y) for x, y in -half ... half. Precondition: these
/// places and their right and lower neighbours are inside the image.
GSV_VECTOR_LOOP void sample(const cv::Mat& image, const Eigen::Vector2f& u_ref,
                            const Eigen::Matrix2f& step, int half, Patch* values) {
  const int side = 2 * half + 1;
  const Eigen::Vector2f across = step.col(0);
  std::array<float, kMaxStride> a, b;  // fractions between pixels
  std::array<int, kMaxStride> u, v;
  std::array<int, kMaxStride> upper_left, upper_right, lower_left, lower_right;
  for (int y = 0; y < side; ++y) {
    const Eigen::Vector2f begin =
        u_ref + step * Eigen::Vector2f(static_cast<float>(-half), static_cast<float>(y - half));
    for (int x = 0; x < side; ++x) {
      const auto k = static_cast<std::size_t>(x);
      const float at_x = begin.x() + static_cast<float>(x) * across.x();
      const float at_y = begin.y() + static_cast<float>(x) * across.y();
      u[k] = static_cast<int>(at_x);
      v[k] = static_cast<int>(at_y);
      a[k] = at_x - static_cast<float>(u[k]);
      b[k] = at_y - static_cast<float>(v[k]);
    }
    for (int x = 0; x < side; ++x) {
      const auto k = static_cast<std::size_t>(x);
      const unsigned char* const upper = image.ptr(v[k]) + u[k];
      const unsigned char* const lower = upper + image.step;
      upper_left[k] = upper[0];
      upper_right[k] = upper[1];
      lower_left[k] = lower[0];
      lower_right[k] = lower[1];
    }
    float* const row = values->data() + y * side;
    for (int x = 0; x < side; ++x) {
      const auto k = static_cast<std::size_t>(x);
      const float upper = static_cast<float>(upper_left[k]) +
                          a[k] * static_cast<float>(upper_right[k] - upper_left[k]);
      const float lower = static_cast<float>(lower_left[k]) +
                          a[k] * static_cast<float>(lower_right[k] - lower_left[k]);
      row[x] = upper + b[k] * (lower - upper);
    }
  }
}

/// Sums over a patch, its gradients and their products.
struct TemplateSums {
  Lanes grey{}, gx{}, gy{};
  Lanes squares{}, xx{}, xy{}, yy{};
};

/// The patch, without the border of one pixel that wide has, and its gradients, all with zero mean.
/// mask: 1 for the pixels of the window, 0 for padding; count: whole kLanes, as in the functions
/// below; pixels: of the window. Sets the sums of the products.
GSV_VECTOR_LOOP TemplateSums differentiate(const float* __restrict wide, std::size_t stride,
                                           const float* __restrict mask, std::size_t count,
                                           float pixels, float* __restrict grey,
                                           float* __restrict gx, float* __restrict gy) {
  TemplateSums sums;
  const float* const above = wide + 1;
  const float* const centre = above + stride;
  for (std::size_t i = 0; i < count; i += kLanes) {
    const Lanes inside = lanes(mask + i);
    const Lanes value = lanes(centre + i) * inside;
    const Lanes x = 0.5f * (lanes(centre + i + 1) - lanes(centre + i - 1)) * inside;
    const Lanes y = 0.5f * (lanes(centre + i + stride) - lanes(above + i)) * inside;
    lanes(grey + i) = value;
    lanes(gx + i) = x;
    lanes(gy + i) = y;
    sums.grey += value;
    sums.gx += x;
    sums.gy += y;
  }
  const float mean = total(sums.grey) / pixels;
  // The residual is zero-mean, so its derivative is the gradient minus the mean gradient.
  const float mean_x = total(sums.gx) / pixels, mean_y = total(sums.gy) / pixels;
  for (std::size_t i = 0; i < count; i += kLanes) {
    const Lanes inside = lanes(mask + i);
    const Lanes value = lanes(grey + i) - mean * inside;
    const Lanes x = lanes(gx + i) - mean_x * inside;
    const Lanes y = lanes(gy + i) - mean_y * inside;
    lanes(grey + i) = value;
    lanes(gx + i) = x;
    lanes(gy + i) = y;
    sums.squares += value * value;
    sums.xx += x * x;
    sums.xy += x * y;
    sums.yy += y * y;
  }
  return sums;
}

/// Of the current image (grey) and the template.
struct MatchSums {
  Lanes grey{}, squares{}, products{}, along_x{}, along_y{};
};

/// Compares the template (expected, gx, gy) with pixels of the image, interpolated at the fractions
/// a and b of a pixel to the right and down.
GSV_VECTOR_LOOP MatchSums compare(const float* __restrict pixels, std::size_t stride, float a,
                                  float b, const float* __restrict mask, std::size_t count,
                                  const float* __restrict expected, const float* __restrict gx,
                                  const float* __restrict gy) {
  MatchSums sums;
  for (std::size_t i = 0; i < count; i += kLanes) {
    const float* const upper = pixels + i;
    const float* const lower = upper + stride;
    const Lanes left = lanes(upper) + b * (lanes(lower) - lanes(upper));
    const Lanes right = lanes(upper + 1) + b * (lanes(lower + 1) - lanes(upper + 1));
    const Lanes grey = (left + a * (right - left)) * lanes(mask + i);
    const Lanes difference = grey - lanes(expected + i);
    sums.grey += grey;
    sums.squares += grey * grey;
    sums.products += grey * lanes(expected + i);
    sums.along_x += lanes(gx + i) * difference;
    sums.along_y += lanes(gy + i) * difference;
  }
  return sums;
}

/// The warped reference patch and its gradients, all with zero mean.
struct Template {
  Patch grey, gx, gy;
  float sum_of_squares = 0;  // of grey
  Eigen::Matrix2f inverse_hessian;

  /// mask: 1 for the pixels of the window, 0 for padding. False when the warped patch leaves
  /// the reference image or lacks texture in two directions.
  bool make(const cv::Mat& reference, const Eigen::Vector2f& u_ref, const Eigen::Matrix2f& warp,
            int window, const std::vector<float>& mask) {
    const Eigen::Matrix2f inverse = warp.inverse();
    const int half = window / 2 + 1;  // including the border that the gradients need
    const float reach =
        static_cast<float>(half) * inverse.cwiseAbs().rowwise().sum().maxCoeff() + 1;
    if (!isFinite(reach) || !contains(reference, u_ref, reach)) return false;
    const auto stride = static_cast<std::size_t>(window + 2);
    Patch wide;
    sample(reference, u_ref, inverse, half, &wide);
    std::fill_n(wide.begin() + static_cast<std::ptrdiff_t>(stride * stride), kLanes, 0.f);

    const float count = static_cast<float>(window * window);
    const TemplateSums sums = differentiate(wide.data(), stride, mask.data(), mask.size(), count,
                                            grey.data(), gx.data(), gy.data());
    sum_of_squares = total(sums.squares);
    Eigen::Matrix2f hessian;
    hessian << total(sums.xx), total(sums.xy), total(sums.xy), total(sums.yy);
    const float trace = hessian.trace();
    if (sum_of_squares < count) return false;  // variance below 1 grey level^2
    if (hessian.determinant() < kMinCornerness * trace * trace) return false;
    inverse_hessian = hessian.inverse();
    return true;
  }
};

/// Rows of `columns` pixels as floats, and after each row others, up to whole kLanes.
GSV_VECTOR_LOOP void widen(const unsigned char* __restrict from, std::size_t step, int rows,
                           std::size_t columns, std::size_t stride, float* __restrict to) {
  for (int y = 0; y < rows; ++y, from += step, to += stride) {
    for (std::size_t begin = 0; begin < columns; begin += kLanes) {
      for (std::size_t k = 0; k < kLanes; ++k) to[begin + k] = from[begin + k];
    }
  }
}

/// The pixels of the current image around a patch, as floats.
class Window {
 public:
  Window(const cv::Mat& image, int window) : image_(image), size_(window) {
    std::fill_n(pixels_.begin(), (size_ + 3) * (size_ + 2), 0.f);
  }

  /// column, row: upper left pixel. Precondition: inside the image with one more row and column.
  void moveTo(int column, int row) {
    if (column == column_ && row == row_) return;
    column_ = column;
    row_ = row;
    const auto stride = static_cast<std::size_t>(size_ + 2);
    const unsigned char* const from = image_.ptr(row) + column;
    const unsigned char* const last = image_.ptr(row + size_) + column;
    // At the end of the memory a row cannot be read in whole kLanes.
    const bool whole = last + size_ + kLanes < image_.datalimit;
    widen(from, image_.step[0], size_ + (whole ? 1 : 0), size_ + 1, stride, pixels_.data());
    if (!whole) std::copy_n(last, size_ + 1, pixels_.data() + size_ * stride);
  }
  const float* pixels() const { return pixels_.data(); }

 private:
  const cv::Mat& image_;
  int size_, column_ = -1, row_ = -1;
  Patch pixels_;
};

}  // namespace

std::optional<Eigen::Matrix2d> patchWarp(const PinholeCamera& camera, const Eigen::Vector3d& p_r,
                                         const Eigen::Isometry3d& T_c_r, PatchSurface surface) {
  const Eigen::Vector3d normal = Eigen::Vector3d::Unit(surface == PatchSurface::kFrontoParallel ? 2
                                                       : surface == PatchSurface::kFloor        ? 1
                                                                                         : 0);
  const Eigen::Vector3d p_c = T_c_r * p_r;
  const double distance = normal.dot(p_r);
  if (p_r.z() <= 0 || p_c.z() <= 0 || std::abs(distance) < kMinGrazingSine * p_r.norm())
    return std::nullopt;
  const Eigen::Vector2d u_r = camera.project(p_r), u_c = camera.project(p_c);
  Eigen::Matrix2d warp;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector3d ray = camera.ray(u_r + kWarpStep_px * Eigen::Vector2d::Unit(axis));
    const double depth = distance / normal.dot(ray);
    const Eigen::Vector3d q = T_c_r * Eigen::Vector3d(depth * ray);
    if (!(depth > 0) || q.z() <= 0) return std::nullopt;
    warp.col(axis) = (camera.project(q) - u_c) / kWarpStep_px;
  }
  const double area = std::abs(warp.determinant());
  if (!(area > kMinAreaRatio && area < 1 / kMinAreaRatio)) return std::nullopt;
  return warp;
}

void PatchAlignment::Options::validate() const {
  visitParameters(*this, RangeCheck("alignment/"));
  if (window_px % 2 == 0) throw OptionError("alignment/window_px must be odd");
}

PatchAlignment::PatchAlignment(const Options& options) : options_(options) {
  options_.validate();
  const int window = options_.window_px, stride = window + 2;
  for (int i = 0; i < window * stride; ++i) mask_.push_back(i % stride < window ? 1.f : 0.f);
  while (mask_.size() % kLanes != 0) mask_.push_back(0.f);
}

std::optional<PatchAlignment::Match> PatchAlignment::align(const cv::Mat& reference,
                                                           const Eigen::Vector2d& u_ref,
                                                           const Eigen::Matrix2d& warp,
                                                           const cv::Mat& current,
                                                           const Eigen::Vector2d& start) const {
  const int window = options_.window_px, half = window / 2;
  Template patch;
  if (!patch.make(reference, u_ref.cast<float>(), warp.cast<float>(), window, mask_)) {
    return std::nullopt;
  }

  const Eigen::Vector2f first = start.cast<float>();
  const float max_shift = static_cast<float>(options_.max_shift_px);
  Eigen::Vector2f u = first;
  float correlation = -1;
  Window around(current, window);
  for (int iteration = 0; iteration < kMaxAlignmentIterations; ++iteration) {
    if (!((u - first).norm() < kMaxIntermediateShift * max_shift) ||
        !contains(current, u, static_cast<float>(half))) {
      return std::nullopt;
    }
    const Eigen::Vector2f corner = u - Eigen::Vector2f::Constant(static_cast<float>(half));
    const int column = static_cast<int>(corner.x()), row = static_cast<int>(corner.y());
    const float a = corner.x() - static_cast<float>(column);
    const float b = corner.y() - static_cast<float>(row);
    around.moveTo(column, row);
    const MatchSums sums =
        compare(around.pixels(), static_cast<std::size_t>(window + 2), a, b, mask_.data(),
                mask_.size(), patch.grey.data(), patch.gx.data(), patch.gy.data());
    const float sum = total(sums.grey);
    const float sum_of_squares =
        total(sums.squares) - sum * sum / static_cast<float>(window * window);
    correlation = total(sums.products) /
                  std::sqrt(std::max(kMinSumOfSquares, sum_of_squares) * patch.sum_of_squares);
    const Eigen::Vector2f step =
        patch.inverse_hessian * Eigen::Vector2f(total(sums.along_x), total(sums.along_y));
    u -= step;
    if (step.norm() < kConverged_px) break;
  }
  if (!((u - first).norm() <= max_shift) || !(correlation >= options_.min_correlation)) {
    return std::nullopt;
  }
  return Match{u.cast<double>(), correlation};
}

}  // namespace ground_scale_vo
