#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

#include "common/simd.hpp"

namespace ground_scale_vo {

// Square patches in floating-point numbers. A patch is stored row by row in a flat array with a
// stride of the side plus two columns. The loops run over the array without regard to rows,
// kSimdFloats pixels at a time, and a mask removes the padding.
//
// Everything is inline, to become part of one GSV_VECTOR_LOOP.

constexpr int kAlignedSide = 9;  ///< [px] side of a patch
constexpr std::size_t kAlignedStride = kAlignedSide + 2;
/// Elements of a patch with the padding; of one with a border of one pixel; and of a FloatWindow
/// that compare() reads.
constexpr std::size_t kAlignedCount = paddedFloats(kAlignedSide * kAlignedStride);
constexpr std::size_t kBorderedCount = paddedFloats(kAlignedStride * kAlignedStride);
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
inline void sample(const cv::Mat& image, const Eigen::Vector2f& u_ref, const Eigen::Matrix2f& step,
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
inline void differentiate(const FloatPatch& wide, ZeroMeanPatch* patch) {
  constexpr std::size_t stride = kAlignedStride, count = kAlignedCount;
  constexpr float pixels = kAlignedSide * kAlignedSide;
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
  const float mean = total(grey_sum) / pixels;
  // The residual is zero-mean, so its derivative is the gradient minus the mean gradient.
  const float mean_x = total(x_sum) / pixels, mean_y = total(y_sum) / pixels;
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
    const auto step = static_cast<std::ptrdiff_t>(image_.step[0]);
    constexpr std::size_t columns = kAlignedSide + 1;
    const unsigned char* from = image_.ptr(row) + column;
    float* to = pixels_.data();
    // At the end of the memory a row cannot be read in whole kSimdFloats.
    const bool whole = from + kAlignedSide * step + paddedFloats(columns) <= image_.datalimit;
    for (int y = 0; y <= kAlignedSide; ++y, from += step, to += kAlignedStride) {
      if (whole) {
        std::copy_n(from, paddedFloats(columns), to);
      } else {
        std::copy_n(from, columns, to);
      }
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
inline MatchSums compare(const float* pixels, float a, float b, const ZeroMeanPatch& patch) {
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

}  // namespace ground_scale_vo
