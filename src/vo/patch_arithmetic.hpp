#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

namespace ground_scale_vo {

// Square patches in 16-bit integers. They are stored row by row in flat arrays; the loops run over
// an array without regard to rows, so that the compiler vectorises them, and the gradients are zero
// in the padding between rows. Sums of products are exact integers: the results do not depend on
// the instruction set.
//
// Everything is inline, to become part of one GSV_VECTOR_LOOP: a patch has only seven chunks, and
// calls would take longer than the arithmetic.

constexpr int kGreyUnit = 32;      ///< value of one grey level
constexpr int kGradientUnit = 16;  ///< value of one grey level per pixel

constexpr int kTrackedSide = 9;  ///< [px] side of a patch
/// [px] that gradients and interpolation between pixels need around a patch, both sides together.
constexpr int kPatchBorder = 3;
/// The loops process whole chunks: one or two vector registers.
constexpr std::size_t kPatchChunk = 16;

constexpr std::size_t wholeChunks(std::size_t count) {
  return (count + kPatchChunk - 1) / kPatchChunk * kPatchChunk;
}

constexpr std::size_t kPatchStride = kTrackedSide + kPatchBorder;  ///< from a row to the next
/// Elements of a patch with the padding, whole chunks.
constexpr std::size_t kPatchCount = wholeChunks(kTrackedSide * kPatchStride);
/// -1: pixel of the patch, 0: padding.
constexpr std::array<std::int16_t, kPatchCount> kPatchMask = [] {
  std::array<std::int16_t, kPatchCount> mask{};
  for (std::size_t i = 0; i < kPatchCount; ++i) {
    mask[i] = i % kPatchStride < kTrackedSide && i / kPatchStride < kTrackedSide ? -1 : 0;
  }
  return mask;
}();

/// Upper left pixel of a patch, and the fractions to its position.
struct PatchCorner {
  int column, row;
  float a, b;
};
/// Precondition: finite, near an image.
inline PatchCorner cornerOf(const cv::Point2f& centre, int side) {
  const float x = centre.x - static_cast<float>(side / 2);
  const float y = centre.y - static_cast<float>(side / 2);
  const float column = std::floor(x), row = std::floor(y);
  return {static_cast<int>(column), static_cast<int>(row), x - column, y - row};
}

/// Elements of a patch with a border, and what loops access beyond it.
constexpr std::size_t kPatchElements = kPatchStride * kPatchStride + 2 * kPatchChunk;
using PatchArray = std::array<std::int16_t, kPatchElements>;

namespace patch_arithmetic {

using Element = std::int16_t;

/// Fractions of a pixel have 15 bits.
constexpr float kFractionUnit = 1 << 15;
inline Element fixedPoint(float fraction) { return static_cast<Element>(fraction * kFractionUnit); }

// Their products are added in 32 bits: a difference of grey is at most 255 * kGreyUnit, a gradient
// 127.5 * kGradientUnit.
static_assert(kPatchCount * (255 * kGreyUnit) * (128 * kGradientUnit) < (std::size_t{1} << 31));

/// The upper 16 bits of the product: rounds down.
inline Element highHalf(Element a, Element b) {
  return static_cast<Element>((static_cast<std::int32_t>(a) * b) >> 16);
}

/// p + fraction * (q - p), rounded to the nearest: with rounding down, the tracks of faint features
/// drift. Written such that gcc translates the product into one instruction of AVX2 (pmulhrsw).
inline Element interpolated(Element p, Element q, Element fraction) {
  const auto difference = static_cast<Element>(q - p);
  const auto part = static_cast<Element>((((difference * std::int32_t{fraction}) >> 14) + 1) >> 1);
  return static_cast<Element>(p + part);
}

/// Between four neighbours, of which p is the upper left one.
inline Element interpolated(const Element* p, std::size_t stride, Element a, Element b) {
  return interpolated(interpolated(p[0], p[stride], b), interpolated(p[1], p[stride + 1], b), a);
}

/// 3/16 outer + 10/16 inner + 3/16 outer, rounded to kGradientUnit; the inputs are differences over
/// two pixels in kGreyUnit.
inline Element smoothed(Element outer_1, Element inner, Element outer_2) {
  constexpr Element kOuterWeight = 3 << 12;
  const auto excess = static_cast<Element>(outer_1 + outer_2 - 2 * inner);
  static_assert(2 * kGreyUnit == kGradientUnit << 2);
  const auto sum = static_cast<Element>(inner + highHalf(excess, kOuterWeight) + 2);
  return static_cast<Element>(sum >> 2);
}

}  // namespace patch_arithmetic

/// The grey levels of a patch and their gradients (Scharr).
struct GradientPatch {
  GradientPatch() {}  // Leaves the arrays uninitialised: set() writes what is read.
  PatchArray grey, x, y;
  float xx, xy, yy;  ///< sums of products of gradients [kGradientUnit^2]

  /// wide: the patch with a border of one pixel.
  void set(const PatchArray& wide) {
    using patch_arithmetic::Element, patch_arithmetic::smoothed;
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
  /// Reads `rows` rows and columns of pixels from (column, row) on, unless they were the last to be
  /// read. Precondition: they are pixels of the image or of the larger one that contains it, and
  /// the images do not change.
  void read(const cv::Mat& image, int column, int row, int rows) {
    // Pointer arithmetic instead of ptr(row): the row may lie outside of the image.
    const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
    const unsigned char* from = image.data + row * step + column;
    if (from == read_from_ && rows == rows_) return;
    read_from_ = from;
    rows_ = rows;
    const auto columns = static_cast<std::ptrdiff_t>(wholeChunks(kPatchStride));
    patch_arithmetic::Element* to = pixels_.data();
    if (from + (rows - 1) * step + columns <= image.datalimit) {
      for (int y = 0; y < rows; ++y, from += step, to += kPatchStride) widen(from, columns, to);
    } else {  // At the end of the memory a row cannot be read in whole chunks.
      for (int y = 0; y < rows; ++y, from += step, to += kPatchStride) {
        widen(from, std::clamp<std::ptrdiff_t>(image.datalimit - from, 0, columns), to);
      }
    }
  }

  /// The pixels shifted by the fractions (a, b) of a pixel, 0 <= a, b < 1: one row less.
  void interpolate(float a, float b, PatchArray* out) const {
    const std::size_t count = wholeChunks((kPatchStride - 1) * kPatchStride);
    const auto across = patch_arithmetic::fixedPoint(a), down = patch_arithmetic::fixedPoint(b);
    for (std::size_t i = 0; i < count; ++i) {
      (*out)[i] = patch_arithmetic::interpolated(&pixels_[i], kPatchStride, across, down);
    }
  }

  /// Sums of gradient times difference of the pixels shifted by (a, b) from the patch [kGreyUnit *
  /// kGradientUnit].
  Eigen::Vector2f gradientTimesDifference(float a, float b, const GradientPatch& patch) const {
    using patch_arithmetic::Element;
    const Element across = patch_arithmetic::fixedPoint(a), down = patch_arithmetic::fixedPoint(b);
    std::int32_t sum_x = 0, sum_y = 0;
    for (std::size_t i = 0; i < kPatchCount; ++i) {
      const Element grey = patch_arithmetic::interpolated(&pixels_[i], kPatchStride, across, down);
      const auto difference = static_cast<Element>(grey - patch.grey[i]);
      sum_x += difference * patch.x[i];
      sum_y += difference * patch.y[i];
    }
    return {static_cast<float>(sum_x), static_cast<float>(sum_y)};
  }

 private:
  static void widen(const unsigned char* __restrict from, std::ptrdiff_t count,
                    std::int16_t* __restrict to) {
    for (std::ptrdiff_t x = 0; x < count; ++x)
      to[x] = static_cast<std::int16_t>(from[x] * kGreyUnit);
  }

  PatchArray pixels_{};
  const unsigned char* read_from_ = nullptr;
  int rows_ = 0;
};

}  // namespace ground_scale_vo
