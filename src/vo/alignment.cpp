#include "vo/alignment.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "common/simd.hpp"
#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// [px] largest shift from the tracked position.
constexpr float kMaxShift_px = 1.5f;
/// The same while iterating.
constexpr float kMaxIntermediateShift_px = 2 * kMaxShift_px;
/// Largest ratio of the sizes of a patch in the current and the reference image.
constexpr double kMaxSizeRatio = 1.6;
constexpr int kMaxAlignmentIterations = 10;  // of Gauss-Newton
/// [px] step of the numeric derivative of the warp: small against a patch, large against rounding.
constexpr double kWarpStep_px = 2;
/// [px] step length at convergence: far below the noise of an aligned corner (0.2 px).
constexpr float kConverged_px = 0.003f;
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

/// If the last successful surface hypothesis reaches this normalised cross-correlation, the others
/// are not tried.
constexpr double kGoodCorrelation = 0.95;

/// Standard deviation of an aligned feature [normalised image coordinates].
constexpr double kAlignedSigma = 0.00025;

// Square patches in floating-point numbers. A patch is stored row by row in a flat array with a
// stride of the side plus two columns. The loops run over the array without regard to rows,
// kSimdFloats pixels at a time, and a mask removes the padding.
//
// Everything is inline, to become part of one GSV_VECTOR_LOOP.

constexpr int kAlignedSide = 9;                         ///< [px] side of a patch
constexpr float kPixels = kAlignedSide * kAlignedSide;  ///< of a patch
constexpr std::size_t kAlignedStride = kAlignedSide + 2;
/// Elements of a patch with the padding; of one with a border of one pixel; and of a FloatWindow
/// that compare() reads.
constexpr std::size_t kAlignedCount = padded(kAlignedSide * kAlignedStride, kSimdFloats);
constexpr std::size_t kBorderedCount = padded(kAlignedStride * kAlignedStride, kSimdFloats);
constexpr std::size_t kWindowCount = kAlignedCount + kAlignedStride + 1;
constexpr std::size_t kMaxElements = kBorderedCount + 2 * kSimdFloats;
static_assert(kWindowCount <= kMaxElements);
using FloatPatch = std::array<float, kMaxElements>;

/// Columns and rows of the elements of a patch with a border of one pixel, from its centre [px].
constexpr FloatPatch kBorderedColumns = [] {
  FloatPatch columns{};
  for (std::size_t i = 0; i < kAlignedStride * kAlignedStride; ++i) {
    columns[i] = static_cast<float>(i % kAlignedStride);
  }
  return columns;
}();
constexpr FloatPatch kBorderedRows = [] {
  FloatPatch rows{};
  for (std::size_t i = 0; i < kAlignedStride * kAlignedStride; ++i) {
    rows[i] = static_cast<float>(i / kAlignedStride) - static_cast<float>(kAlignedStride / 2);
  }
  return rows;
}();
/// Of the elements of a patch: 1 pixel of the patch, 0 padding.
constexpr FloatPatch kFloatMask = [] {
  FloatPatch mask{};
  for (std::size_t i = 0; i < kAlignedSide * kAlignedStride; ++i) {
    mask[i] = i % kAlignedStride < kAlignedSide ? 1.f : 0.f;
  }
  return mask;
}();

/// Interpolates the image at u_ref + step * (x, y) for the pixels (x, y) of a patch with a border
/// of one pixel, from its centre. Precondition: these places and their right and lower neighbours
/// are inside the image.
void sample(const cv::Mat& image, const Eigen::Vector2f& u_ref, const Eigen::Matrix2f& step,
            FloatPatch* values) {
  constexpr float left = -(kAlignedSide / 2 + 1);
  constexpr std::size_t places = kAlignedStride * kAlignedStride, count = kBorderedCount;
  const auto image_step = static_cast<std::int32_t>(image.step[0]);
  FloatPatch a, b;  // fractions between pixels
  // Offset of the upper left pixel; upper two pixels and lower two, the right one times 256.
  std::array<std::int32_t, kMaxElements> offset, upper, lower;
  for (std::size_t i = 0; i < count; i += kSimdFloats) {
    const Floats x = simd(&kBorderedColumns[i]), y = simd(&kBorderedRows[i]);
    const Floats at_x = u_ref.x() + (step(0, 0) * left + step(0, 1) * y) + x * step(0, 0);
    const Floats at_y = u_ref.y() + (step(1, 0) * left + step(1, 1) * y) + x * step(1, 0);
    const Ints u = __builtin_convertvector(at_x, Ints);
    const Ints v = __builtin_convertvector(at_y, Ints);
    simd(&a[i]) = at_x - __builtin_convertvector(u, Floats);
    simd(&b[i]) = at_y - __builtin_convertvector(v, Floats);
    simd(&offset[i]) = v * image_step + u;
  }
  for (std::size_t i = 0; i < places; ++i) {
    const unsigned char* const p = image.data + offset[i];
    const unsigned char* const q = p + image_step;
    upper[i] = p[0] | p[1] << 8;
    lower[i] = q[0] | q[1] << 8;
  }
  std::fill(upper.begin() + places, upper.begin() + count, 0);
  std::fill(lower.begin() + places, lower.begin() + count, 0);
  for (std::size_t i = 0; i < count; i += kSimdFloats) {
    const Ints upper_left = simd(&upper[i]) & 255, upper_right = simd(&upper[i]) >> 8;
    const Ints lower_left = simd(&lower[i]) & 255, lower_right = simd(&lower[i]) >> 8;
    const Floats above = __builtin_convertvector(upper_left, Floats) +
                         simd(&a[i]) * __builtin_convertvector(upper_right - upper_left, Floats);
    const Floats below = __builtin_convertvector(lower_left, Floats) +
                         simd(&a[i]) * __builtin_convertvector(lower_right - lower_left, Floats);
    simd(values->data() + i) = above + simd(&b[i]) * (below - above);
  }
  std::fill_n(values->begin() + count, kSimdFloats, 0.f);
}

/// A patch and its gradients, all with zero mean.
struct ZeroMeanPatch {
  FloatPatch grey, gx, gy;
  float squares;     ///< sum over grey
  float xx, xy, yy;  ///< sums of products of gradients
};

/// Sets the patch without the border of one pixel that `wide` has.
void differentiate(const FloatPatch& wide, ZeroMeanPatch* patch) {
  constexpr std::size_t stride = kAlignedStride, count = kAlignedCount;
  const float* const mask = kFloatMask.data();
  Floats grey_sum{}, x_sum{}, y_sum{};
  for (std::size_t i = 0; i < count; i += kSimdFloats) {
    const float* const centre = &wide[i + stride + 1];
    const Floats inside = simd(mask + i);
    const Floats value = simd(centre) * inside;
    const Floats x = 0.5f * (simd(centre + 1) - simd(centre - 1)) * inside;
    const Floats y = 0.5f * (simd(centre + stride) - simd(centre - stride)) * inside;
    simd(&patch->grey[i]) = value;
    simd(&patch->gx[i]) = x;
    simd(&patch->gy[i]) = y;
    grey_sum += value;
    x_sum += x;
    y_sum += y;
  }
  const float mean = total(grey_sum) / kPixels;
  // The residual is zero-mean, so its derivative is the gradient minus the mean gradient.
  const float mean_x = total(x_sum) / kPixels, mean_y = total(y_sum) / kPixels;
  Floats squares{}, xx{}, xy{}, yy{};
  for (std::size_t i = 0; i < count; i += kSimdFloats) {
    const Floats inside = simd(mask + i);
    const Floats value = simd(&patch->grey[i]) - mean * inside;
    const Floats x = simd(&patch->gx[i]) - mean_x * inside;
    const Floats y = simd(&patch->gy[i]) - mean_y * inside;
    simd(&patch->grey[i]) = value;
    simd(&patch->gx[i]) = x;
    simd(&patch->gy[i]) = y;
    squares += value * value;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  patch->squares = total(squares);
  patch->xx = total(xx);
  patch->xy = total(xy);
  patch->yy = total(yy);
}

/// The pixels of an image around a patch.
class FloatWindow {
 public:
  explicit FloatWindow(const cv::Mat& image) : image_(image) {
    std::fill_n(pixels_.begin(), kWindowCount, 0.f);
  }

  /// column, row: upper left pixel. Precondition: inside the image with one more row and column.
  void moveTo(int column, int row) {
    if (column == column_ && row == row_) return;
    column_ = column;
    row_ = row;
    float* to = pixels_.data();
    for (int y = 0; y <= kAlignedSide; ++y, to += kAlignedStride) {
      std::copy_n(image_.ptr(row + y) + column, kAlignedSide + 1, to);
    }
  }
  const float* data() const { return pixels_.data(); }

 private:
  const cv::Mat& image_;
  int column_ = -1, row_ = -1;
  FloatPatch pixels_;
};

/// Sums over the pixels of an image and a patch.
struct MatchSums {
  Floats grey{}, squares{}, products{}, along_x{}, along_y{};
};

/// Compares a patch with pixels of a FloatWindow, interpolated at the fractions a and b of a pixel
/// to the right and down.
MatchSums compare(const float* pixels, float a, float b, const ZeroMeanPatch& patch) {
  const float* const mask = kFloatMask.data();
  MatchSums sums;
  for (std::size_t i = 0; i < kAlignedCount; i += kSimdFloats) {
    const float* const upper = pixels + i;
    const float* const lower = upper + kAlignedStride;
    const Floats left = simd(upper) + b * (simd(lower) - simd(upper));
    const Floats right = simd(upper + 1) + b * (simd(lower + 1) - simd(upper + 1));
    const Floats grey = (left + a * (right - left)) * simd(mask + i);
    const Floats difference = grey - simd(&patch.grey[i]);
    sums.grey += grey;
    sums.squares += grey * grey;
    sums.products += grey * simd(&patch.grey[i]);
    sums.along_x += simd(&patch.gx[i]) * difference;
    sums.along_y += simd(&patch.gy[i]) * difference;
  }
  return sums;
}

/// Normalised, of a patch with the pixels of which these are the sums.
float correlation(const MatchSums& sums, const ZeroMeanPatch& patch) {
  const float sum = total(sums.grey);
  const float squares = total(sums.squares) - sum * sum / kPixels;
  return total(sums.products) / std::sqrt(std::max(kMinSumOfSquares, squares) * patch.squares);
}

/// u: start, replaced by the result [px]; match: its correlation. False when a patch lacks texture
/// in two directions, or the search leaves the image or the neighbourhood of the start. flatten:
/// all that it calls becomes part of it, and so of its version for AVX2.
GSV_VECTOR_LOOP __attribute__((flatten)) bool searchPatch(const cv::Mat& reference,
                                                          const Eigen::Vector2f& u_ref,
                                                          const Eigen::Matrix2f& inverse_warp,
                                                          const cv::Mat& current,
                                                          Eigen::Vector2f* u, float* match) {
  FloatPatch wide;
  ZeroMeanPatch patch;
  sample(reference, u_ref, inverse_warp, &wide);
  differentiate(wide, &patch);
  Eigen::Matrix2f hessian;
  hessian << patch.xx, patch.xy, patch.xy, patch.yy;
  const float trace = hessian.trace();
  if (patch.squares < kPixels) return false;  // variance below 1 grey level^2
  if (hessian.determinant() < kMinCornerness * trace * trace) return false;
  const Eigen::Matrix2f inverse_hessian = hessian.inverse();

  constexpr float half = kAlignedSide / 2;
  FloatWindow around(current);
  const Eigen::Vector2f start = *u;
  MatchSums sums;
  for (int iteration = 0; iteration < kMaxAlignmentIterations; ++iteration) {
    if (!((*u - start).norm() < kMaxIntermediateShift_px) ||
        !isInside(current, {u->x(), u->y()}, half)) {
      return false;
    }
    const Eigen::Vector2f corner = *u - Eigen::Vector2f::Constant(half);
    const int column = static_cast<int>(corner.x()), row = static_cast<int>(corner.y());
    around.moveTo(column, row);
    sums = compare(around.data(), corner.x() - static_cast<float>(column),
                   corner.y() - static_cast<float>(row), patch);
    const Eigen::Vector2f step =
        inverse_hessian * Eigen::Vector2f(total(sums.along_x), total(sums.along_y));
    *u -= step;
    if (step.norm() < kConverged_px) break;
  }
  *match = correlation(sums, patch);
  return true;
}

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

std::optional<PatchMatch> alignPatch(const cv::Mat& reference, const Eigen::Vector2d& u_ref,
                                     const Eigen::Matrix2d& warp, const cv::Mat& current,
                                     const Eigen::Vector2d& start, double min_correlation) {
  const Eigen::Matrix2f inverse_warp = warp.cast<float>().inverse();
  // Half the side in the reference, including the border that the gradients need.
  const float reach = static_cast<float>(kAlignedSide / 2 + 1) *
                          inverse_warp.cwiseAbs().rowwise().sum().maxCoeff() +
                      1;
  if (!isFinite(reach) || !isInside(reference, toCv(u_ref), reach)) return std::nullopt;
  const Eigen::Vector2f from = start.cast<float>();
  Eigen::Vector2f u = from;
  float correlation = -1;
  if (!searchPatch(reference, u_ref.cast<float>(), inverse_warp, current, &u, &correlation) ||
      !((u - from).norm() <= kMaxShift_px) || !(correlation >= min_correlation)) {
    return std::nullopt;
  }
  return PatchMatch{u.cast<double>(), correlation};
}

void ReferenceAlignment::align(const LocalMap& map, const ImagePyramid& image,
                               const Eigen::Isometry3d& predicted_T_w_c,
                               std::vector<Feature>* features) {
  const Eigen::Isometry3d T_c_w = predicted_T_w_c.inverse();
  updateViews(map, image.exposure, T_c_w);
  for (Feature& feature : *features) {
    if (const auto reference = findReference(map, feature, T_c_w)) {
      alignFeature(*reference, image.image, &feature);
    }
  }
}

/// Applies the gain only for new keyframes or a changed gain.
void ReferenceAlignment::updateViews(const LocalMap& map, double exposure,
                                     const Eigen::Isometry3d& T_c_w) {
  std::vector<View> views;
  for (const Keyframe& keyframe : map.keyframes()) {
    const double gain = exposure / keyframe.exposure;
    const auto known = std::find_if(views_.begin(), views_.end(), [&](const View& view) {
      return view.original.data == keyframe.image.data && view.gain == gain;
    });
    views.push_back({keyframe.image, gain,
                     known != views_.end() ? known->image : applyGain(keyframe.image, gain),
                     keyframe.T_w_c.inverse(), T_c_w * keyframe.T_w_c});
  }
  views_ = std::move(views);
}

/// The patch in the earliest keyframe that observed the feature and from which its size in the
/// current image differs little.
std::optional<ReferenceAlignment::Reference> ReferenceAlignment::findReference(
    const LocalMap& map, const Feature& feature, const Eigen::Isometry3d& T_c_w) const {
  const Landmark* const landmark = map.find(feature.id);
  const auto point = landmark ? map.point(*landmark) : std::nullopt;
  if (!landmark || !point) return std::nullopt;
  const double depth = (T_c_w * point->p_w).z();
  if (!(depth > 0)) return std::nullopt;
  for (const Observation& o : landmark->observations) {
    const View& view = views_[map.indexOf(o.keyframe)];
    const Eigen::Vector3d p_r = view.T_r_w * point->p_w;
    const double scale = p_r.z() / depth;
    if (view.image.empty() || scale > kMaxSizeRatio || scale < 1 / kMaxSizeRatio) continue;
    return Reference{&view, camera_.project(o.x.homogeneous()) - o.to_stamp, p_r};
  }
  return std::nullopt;
}

/// Tries the last successful surface hypothesis, and the others when it does not fit well.
void ReferenceAlignment::alignFeature(const Reference& reference, const cv::Mat& image,
                                      Feature* feature) const {
  const Feature tracked = *feature;
  double correlation = -1;
  const auto trySurface = [&](PatchSurface surface) {
    const auto warp = patchWarp(camera_, reference.p_r, reference.view->T_c_r, surface);
    if (!warp) return;
    const auto match =
        alignPatch(reference.view->image, reference.u, *warp, image, tracked.u, min_correlation_);
    if (!match || correlation >= match->correlation) return;
    correlation = match->correlation;
    feature->u = match->u;
    feature->sigma = kAlignedSigma;
    feature->surface = surface;
  };
  trySurface(tracked.surface);
  if (correlation >= kGoodCorrelation) return;
  for (const auto surface :
       {PatchSurface::kFrontoParallel, PatchSurface::kFloor, PatchSurface::kWall}) {
    if (surface != tracked.surface) trySurface(surface);
  }
}

}  // namespace gsv
