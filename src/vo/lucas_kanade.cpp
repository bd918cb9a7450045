#include "vo/lucas_kanade.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "common/simd.hpp"
#include "common/vector_loop.hpp"

namespace gsv {
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

constexpr double kPartsPerThread = 4;  // of the points: more would balance the load no better

// Square patches in 16-bit integers. They are stored row by row in flat arrays; the loops run over
// an array without regard to rows, so that the compiler vectorises them, and the gradients are zero
// in the padding between rows. Sums of products are exact integers: the results do not depend on
// the instruction set.
//
// Everything is inline, to become part of one GSV_VECTOR_LOOP: a patch has only seven chunks, and
// calls would take longer than the arithmetic.

constexpr int kGreyUnit = 32;      ///< value of one grey level
constexpr int kGradientUnit = 16;  ///< value of one grey level per pixel

/// [px] that gradients and interpolation between pixels need around a patch, both sides together.
constexpr int kPatchBorder = 3;
/// The loops process whole chunks: one or two vector registers.
constexpr std::size_t kPatchChunk = 16;

constexpr std::size_t kPatchStride = kTrackedSide + kPatchBorder;  ///< from a row to the next
/// Elements of a patch with the padding, whole chunks.
constexpr std::size_t kPatchCount = padded(kTrackedSide * kPatchStride, kPatchChunk);
/// -1: pixel of the patch, 0: padding.
constexpr std::array<std::int16_t, kPatchCount> kPatchMask = [] {
  std::array<std::int16_t, kPatchCount> mask{};
  for (std::size_t i = 0; i < kPatchCount; ++i) {
    mask[i] = i % kPatchStride < kTrackedSide && i / kPatchStride < kTrackedSide ? -1 : 0;
  }
  return mask;
}();

/// Elements of a patch with a border, and what loops access beyond it.
constexpr std::size_t kPatchElements = kPatchStride * kPatchStride + 2 * kPatchChunk;
using PatchArray = std::array<std::int16_t, kPatchElements>;

using Element = std::int16_t;

/// Fractions of a pixel have 15 bits.
constexpr float kFractionUnit = 1 << 15;
Element fixedPoint(float fraction) { return static_cast<Element>(fraction * kFractionUnit); }

// Their products are added in 32 bits: a difference of grey is at most 255 * kGreyUnit, a gradient
// 127.5 * kGradientUnit.
static_assert(kPatchCount * (255 * kGreyUnit) * (128 * kGradientUnit) < (std::size_t{1} << 31));

/// The upper 16 bits of the product: rounds down.
Element highHalf(Element a, Element b) {
  return static_cast<Element>((static_cast<std::int32_t>(a) * b) >> 16);
}

/// p + fraction * (q - p), rounded to the nearest: with rounding down, the tracks of faint features
/// drift. Written such that gcc translates the product into one instruction of AVX2 (pmulhrsw).
Element interpolated(Element p, Element q, Element fraction) {
  const auto difference = static_cast<Element>(q - p);
  const auto part = static_cast<Element>((((difference * std::int32_t{fraction}) >> 14) + 1) >> 1);
  return static_cast<Element>(p + part);
}

/// Between four neighbours, of which p is the upper left one.
Element interpolated(const Element* p, std::size_t stride, Element a, Element b) {
  return interpolated(interpolated(p[0], p[stride], b), interpolated(p[1], p[stride + 1], b), a);
}

/// 3/16 outer + 10/16 inner + 3/16 outer, rounded to kGradientUnit; the inputs are differences over
/// two pixels in kGreyUnit.
Element smoothed(Element outer_1, Element inner, Element outer_2) {
  constexpr Element kOuterWeight = 3 << 12;
  const auto excess = static_cast<Element>(outer_1 + outer_2 - 2 * inner);
  static_assert(2 * kGreyUnit == kGradientUnit << 2);
  const auto sum = static_cast<Element>(inner + highHalf(excess, kOuterWeight) + 2);
  return static_cast<Element>(sum >> 2);
}

/// The grey levels of a patch and their gradients (Scharr).
struct GradientPatch {
  GradientPatch() {}  // Leaves the arrays uninitialised: set() writes what is read.
  PatchArray grey, x, y;
  float xx, xy, yy;  ///< sums of products of gradients [kGradientUnit^2]
  /// For sums of gradient times difference [px / (kGreyUnit * kGradientUnit)].
  Eigen::Matrix2f inverse_hessian;

  /// wide: the patch with a border of one pixel.
  void set(const PatchArray& wide) {
    std::int32_t sum_xx = 0, sum_xy = 0, sum_yy = 0;
    for (std::size_t i = 0; i < kPatchCount; ++i) {
      const Element* const upper = wide.data() + i;
      const Element* const middle = upper + kPatchStride;
      const Element* const lower = middle + kPatchStride;
      const auto gradient_x = smoothed(static_cast<Element>(upper[2] - upper[0]),
                                       static_cast<Element>(middle[2] - middle[0]),
                                       static_cast<Element>(lower[2] - lower[0]));
      const auto gradient_y = smoothed(static_cast<Element>(lower[0] - upper[0]),
                                       static_cast<Element>(lower[1] - upper[1]),
                                       static_cast<Element>(lower[2] - upper[2]));
      grey[i] = middle[1];
      x[i] = static_cast<Element>(gradient_x & kPatchMask[i]);
      y[i] = static_cast<Element>(gradient_y & kPatchMask[i]);
      sum_xx += x[i] * x[i];
      sum_xy += x[i] * y[i];
      sum_yy += y[i] * y[i];
    }
    xx = static_cast<float>(sum_xx);
    xy = static_cast<float>(sum_xy);
    yy = static_cast<float>(sum_yy);
  }
};

/// Pixels of an image around a patch, and their values between pixels.
class PixelWindow {
 public:
  /// Reads the pixels of a patch with a border, and those right and below of them. Precondition:
  /// the centre is finite; the pixels are of the image or of the larger one that contains it, and
  /// do not change.
  void moveTo(const cv::Mat& image, const cv::Point2f& centre, int border) {
    const float x = centre.x - static_cast<float>(kTrackedSide / 2);
    const float y = centre.y - static_cast<float>(kTrackedSide / 2);
    const float column = std::floor(x), row = std::floor(y);
    across_ = fixedPoint(x - column);
    down_ = fixedPoint(y - row);
    read(image, static_cast<int>(column) - border, static_cast<int>(row) - border,
         kTrackedSide + 2 * border + 1);
  }

  /// The patch, with a border of one pixel.
  void interpolate(PatchArray* out) const {
    const Element across = across_, down = down_;
    const std::size_t count = padded((kPatchStride - 1) * kPatchStride, kPatchChunk);
    for (std::size_t i = 0; i < count; ++i) {
      (*out)[i] = interpolated(&pixels_[i], kPatchStride, across, down);
    }
  }

  /// Sums of gradient times difference from a patch [kGreyUnit * kGradientUnit].
  Eigen::Vector2f gradientTimesDifference(const GradientPatch& patch) const {
    const Element across = across_, down = down_;
    std::int32_t sum_x = 0, sum_y = 0;
    for (std::size_t i = 0; i < kPatchCount; ++i) {
      const Element grey = interpolated(&pixels_[i], kPatchStride, across, down);
      const auto difference = static_cast<Element>(grey - patch.grey[i]);
      sum_x += difference * patch.x[i];
      sum_y += difference * patch.y[i];
    }
    return {static_cast<float>(sum_x), static_cast<float>(sum_y)};
  }

 private:
  /// Unless these rows and columns were the last to be read.
  void read(const cv::Mat& image, int column, int row, int rows) {
    // Pointer arithmetic instead of ptr(row): the row may lie outside of the image.
    const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
    const unsigned char* from = image.data + row * step + column;
    if (from == read_from_ && rows == rows_) return;
    read_from_ = from;
    rows_ = rows;
    Element* to = pixels_.data();
    for (int y = 0; y < rows; ++y, from += step, to += kPatchStride) widen(from, to);
  }

  static void widen(const unsigned char* __restrict from, Element* __restrict to) {
    for (std::size_t x = 0; x < padded(kPatchStride, kPatchChunk); ++x) {
      to[x] = static_cast<Element>(from[x] * kGreyUnit);
    }
  }

  PatchArray pixels_{};
  Element across_ = 0, down_ = 0;  ///< from the pixels to the patch
  const unsigned char* read_from_ = nullptr;
  int rows_ = 0;
};

/// Whether a patch overlaps the image; false for coordinates that are not finite.
bool overlaps(const cv::Mat& image, const cv::Point2f& centre) {
  return isInside(image, centre, static_cast<float>(kTrackedSide / 2 - kTrackedSide));
}

float smallerEigenvalue(const GradientPatch& m) {
  const double difference = m.xx - m.yy, twice = 2 * m.xy;
  const auto radius = static_cast<float>(std::sqrt(difference * difference + twice * twice));
  return (m.xx + m.yy - radius) / 2;
}

/// The memory of a search.
struct Search {
  PixelWindow window;
  PatchArray wide{};  ///< a patch with a border of one pixel
  GradientPatch finest, coarser;
};

// flatten: all that these call becomes part of them, and so of their version for AVX2.

GSV_VECTOR_LOOP __attribute__((flatten)) void readPatch(const cv::Mat& image,
                                                        const cv::Point2f& centre,
                                                        PixelWindow* __restrict window,
                                                        PatchArray* __restrict wide,
                                                        GradientPatch* __restrict patch) {
  window->moveTo(image, centre, 1);
  window->interpolate(wide);
  patch->set(*wide);
}

/// Where the search ends, possibly outside of the image.
GSV_VECTOR_LOOP __attribute__((flatten)) cv::Point2f minimise(const GradientPatch& patch,
                                                              const cv::Mat& image,
                                                              PixelWindow* window,
                                                              cv::Point2f point) {
  cv::Point2f previous_step;
  for (int iteration = 0; iteration < kMaxTrackingIterations; ++iteration) {
    if (!overlaps(image, point)) break;
    window->moveTo(image, point, 0);
    const Eigen::Vector2f product = -patch.inverse_hessian * window->gradientTimesDifference(patch);
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

/// Reads the patch of a level. False when it does not overlap the image, or has no texture in two
/// directions.
bool readUsable(const cv::Mat& image, const cv::Point2f& centre, Search* search,
                GradientPatch* patch) {
  if (!overlaps(image, centre)) return false;
  readPatch(image, centre, &search->window, &search->wide, patch);
  constexpr float pixels = kTrackedSide * kTrackedSide;
  if (smallerEigenvalue(*patch) <
      kMinSquaredGradient * pixels * static_cast<float>(kGradientUnit * kGradientUnit)) {
    return false;
  }
  Eigen::Matrix2f hessian;
  hessian << patch->xx, patch->xy, patch->xy, patch->yy;
  patch->inverse_hessian = hessian.inverse() * (static_cast<float>(kGradientUnit) / kGreyUnit);
  return true;
}

/// Pyramidal Lucas-Kanade (Bouguet 2000): finds the displacement that minimises the squared
/// differences of grey levels. Gauss-Newton with the gradients of the first image. point: initial
/// guess in the second pyramid, replaced by the result. levels: to use above the full resolution.
bool find(const ImagePyramid& from, const ImagePyramid& to, const cv::Point2f& from_point,
          int levels, Search* search, cv::Point2f* point) {
  if (!readUsable(from.levels[0], from_point, search, &search->finest)) return false;
  for (int level = std::min(levels, static_cast<int>(from.levels.size()) - 1); level >= 0;
       --level) {
    const auto k = static_cast<std::size_t>(level);
    const auto scale = static_cast<float>(1 << level);
    GradientPatch& patch = level == 0 ? search->finest : search->coarser;
    if (level > 0 && !readUsable(from.levels[k], from_point / scale, search, &patch)) continue;
    *point = minimise(patch, to.levels[k], &search->window, *point / scale) * scale;
  }
  return overlaps(to.levels[0], *point);
}

/// Whether the patch is found in the second image, where `allowed` is not 0, and from there in the
/// first image again, where it comes from. point: initial guess, replaced by the result.
bool findThereAndBack(const ImagePyramid& from, const ImagePyramid& to,
                      const cv::Point2f& from_point, int levels, const cv::Mat& allowed,
                      Search* search, cv::Point2f* point) {
  if (!find(from, to, from_point, levels, search, point) || !isInside(to.image, *point, 1)) {
    return false;
  }
  if (!allowed.empty() && allowed.at<unsigned char>(cvRound(point->y), cvRound(point->x)) == 0) {
    return false;
  }
  cv::Point2f returned = from_point;
  return find(to, from, *point, 0, search, &returned) &&
         cv::norm(returned - from_point) <= kMaxReturnError_px;
}

}  // namespace

ImagePyramid trackingPyramid(const cv::Mat& image) {
  ImagePyramid result;
  // A patch outside, and its own border; and a row, because PixelWindow reads whole chunks.
  constexpr int border = kPatchStride, spare = 1;
  for (cv::Size size = image.size(); static_cast<int>(result.levels.size()) <= kPyramidLevels;
       size = {(size.width + 1) / 2, (size.height + 1) / 2}) {
    if (!result.levels.empty() && std::min(size.width, size.height) <= kTrackedSide) break;
    cv::Mat memory(size.height + 2 * border + spare, size.width + 2 * border, CV_8UC1);
    cv::Mat with_border = memory.rowRange(0, memory.rows - spare);
    cv::Mat level = with_border({{border, border}, size});
    if (result.levels.empty()) {
      image.copyTo(level);
    } else {
      cv::pyrDown(result.levels.back(), level, size);
    }
    cv::copyMakeBorder(level, with_border, border, border, border, border,
                       cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
    result.levels.push_back(level);
  }
  result.image = result.levels.front();
  return result;
}

std::vector<std::optional<cv::Point2f>> trackPoints(const ImagePyramid& from,
                                                    const ImagePyramid& to,
                                                    const std::vector<cv::Point2f>& points,
                                                    const std::vector<cv::Point2f>& predicted,
                                                    const cv::Mat& allowed) {
  std::vector<std::optional<cv::Point2f>> tracks(points.size());
  const auto trackRange = [&](const cv::Range& range) {
    Search search;
    for (int k = range.start; k < range.end; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const auto findFrom = [&](cv::Point2f point, int levels) {
        if (findThereAndBack(from, to, points[i], levels, allowed, &search, &point)) {
          tracks[i] = point;
        }
        return tracks[i].has_value();
      };
      if (!predicted.empty() && findFrom(predicted[i], kLevelsNearPrediction)) continue;
      findFrom(points[i], kPyramidLevels);
    }
  };
  const cv::Range all(0, static_cast<int>(points.size()));
#ifdef __SANITIZE_THREAD__
  // ThreadSanitizer does not see how libtbb, which is built without it, synchronises the threads.
  trackRange(all);
#else
  // Left to itself, OpenCV with libtbb makes over a hundred parts, each with the memory of a
  // search.
  cv::parallel_for_(all, trackRange, kPartsPerThread * cv::getNumThreads());
#endif
  return tracks;
}

}  // namespace gsv
