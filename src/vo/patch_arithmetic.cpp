#include "vo/patch_arithmetic.hpp"

#include <algorithm>

#include "common/vector_loop.hpp"

namespace ground_scale_vo {
namespace {

/// Fractions of a pixel have 15 bits.
constexpr float kFractionUnit = 1 << 15;

/// Elements whose products may be added in 32 bits: a difference of grey is at most 255 *
/// kGreyUnit, a gradient 127.5 * kGradientUnit.
constexpr std::size_t kMaxSummed = 128;
static_assert(kMaxSummed * (255 * kGreyUnit) * (128 * kGradientUnit) < (std::size_t{1} << 31));

using Element = std::int16_t;

/// The upper 16 bits of the product: rounds down.
inline Element highHalf(Element a, Element b) {
  return static_cast<Element>((static_cast<std::int32_t>(a) * b) >> 16);
}

/// Rounded to the nearest: with rounding down, the tracks of faint features drift. 4 * (q - p) fits
/// in 16 bits, because a difference of grey is at most 255 * kGreyUnit.
inline Element interpolated(Element p, Element q, Element fraction) {
  const Element twice = highHalf(static_cast<Element>((q - p) * 4), fraction);
  return static_cast<Element>(p + ((twice + 1) >> 1));
}

/// 3/16 outer + 10/16 inner + 3/16 outer, rounded to kGradientUnit; the inputs are differences over
/// two pixels in kGreyUnit.
inline Element smoothed(Element outer_1, Element inner, Element outer_2) {
  constexpr Element kOuterWeight = 3 << 12;
  const auto excess = static_cast<Element>(outer_1 + outer_2 - 2 * inner);
  static_assert(2 * kGreyUnit == kGradientUnit << 2);
  return static_cast<Element>((inner + highHalf(excess, kOuterWeight) + 2) >> 2);
}

/// count: whole chunks.
GSV_VECTOR_LOOP void interpolateAlong(const Element* __restrict from, std::size_t step,
                                      std::size_t count, Element fraction, Element* __restrict to) {
  const Element* const next = from + step;
  for (std::size_t i = 0; i < count / kPatchChunk * kPatchChunk; ++i) {
    to[i] = interpolated(from[i], next[i], fraction);
  }
}

GSV_VECTOR_LOOP void scharr(const Element* __restrict wide, std::size_t stride,
                            const Element* __restrict mask, std::size_t count,
                            Element* __restrict grey, Element* __restrict x,
                            Element* __restrict y) {
  const Element* const middle = wide + stride;
  const Element* const lower = middle + stride;
  for (std::size_t i = 0; i < count / kPatchChunk * kPatchChunk; ++i) {
    grey[i] = middle[i + 1];
    const auto upper_x = static_cast<Element>(wide[i + 2] - wide[i]);
    const auto middle_x = static_cast<Element>(middle[i + 2] - middle[i]);
    const auto lower_x = static_cast<Element>(lower[i + 2] - lower[i]);
    x[i] = static_cast<Element>(smoothed(upper_x, middle_x, lower_x) & mask[i]);
    const auto left_y = static_cast<Element>(lower[i] - wide[i]);
    const auto middle_y = static_cast<Element>(lower[i + 1] - wide[i + 1]);
    const auto right_y = static_cast<Element>(lower[i + 2] - wide[i + 2]);
    y[i] = static_cast<Element>(smoothed(left_y, middle_y, right_y) & mask[i]);
  }
}

// Sums over at most kMaxSummed elements, in whole chunks.

GSV_VECTOR_LOOP void addGradients(const Element* __restrict x, const Element* __restrict y,
                                  std::size_t count, GradientSums* sums) {
  std::int32_t xx = 0, xy = 0, yy = 0;
  for (std::size_t i = 0; i < count / kPatchChunk * kPatchChunk; ++i) {
    xx += x[i] * x[i];
    xy += x[i] * y[i];
    yy += y[i] * y[i];
  }
  sums->xx += static_cast<float>(xx);
  sums->xy += static_cast<float>(xy);
  sums->yy += static_cast<float>(yy);
}

/// rows: to be shifted by `fraction` of a pixel.
GSV_VECTOR_LOOP void addGradientTimesDifference(const Element* __restrict rows, Element fraction,
                                                const Element* __restrict grey,
                                                const Element* __restrict x,
                                                const Element* __restrict y, std::size_t count,
                                                Eigen::Vector2f* sum) {
  const Element* const next = rows + 1;
  std::int32_t sum_x = 0, sum_y = 0;
  for (std::size_t i = 0; i < count / kPatchChunk * kPatchChunk; ++i) {
    const auto difference =
        static_cast<Element>(interpolated(rows[i], next[i], fraction) - grey[i]);
    sum_x += difference * x[i];
    sum_y += difference * y[i];
  }
  sum->x() += static_cast<float>(sum_x);
  sum->y() += static_cast<float>(sum_y);
}

/// columns: whole chunks.
GSV_VECTOR_LOOP void widen(const unsigned char* __restrict pixels, std::size_t step, int rows,
                           std::size_t columns, std::size_t stride, Element* __restrict to) {
  for (int y = 0; y < rows; ++y, pixels += step, to += stride) {
    for (std::size_t begin = 0; begin < columns; begin += kPatchChunk) {
      for (std::size_t x = begin; x < begin + kPatchChunk; ++x) {
        to[x] = static_cast<Element>(pixels[x] * kGreyUnit);
      }
    }
  }
}

template <typename Function>
void forBlocks(std::size_t count, Function&& function) {
  for (std::size_t begin = 0; begin < count; begin += kMaxSummed) {
    function(begin, std::min(kMaxSummed, count - begin));
  }
}

std::size_t wholeChunks(std::size_t count) {
  return (count + kPatchChunk - 1) / kPatchChunk * kPatchChunk;
}

Element fixedPoint(float fraction) { return static_cast<Element>(fraction * kFractionUnit); }

}  // namespace

PatchLayout::PatchLayout(int side_px)
    : side(side_px),
      stride(static_cast<std::size_t>(side_px + kPatchBorder)),
      count(wholeChunks(static_cast<std::size_t>(side_px) * stride)),
      elements(stride * stride + 2 * kPatchChunk),
      mask(count) {
  for (std::size_t i = 0; i < count; ++i) {
    const bool is_pixel =
        i % stride < static_cast<std::size_t>(side) && i / stride < static_cast<std::size_t>(side);
    mask[i] = is_pixel ? -1 : 0;
  }
}

GradientSums GradientPatch::set(const PatchArray& wide) {
  scharr(wide.data(), layout_.stride, layout_.mask.data(), layout_.count, grey_.data(), x_.data(),
         y_.data());
  GradientSums sums;
  forBlocks(layout_.count, [&](std::size_t begin, std::size_t count) {
    addGradients(x_.data() + begin, y_.data() + begin, count, &sums);
  });
  return sums;
}

void PixelWindow::read(const cv::Mat& image, int column, int row, int rows) {
  // Pointer arithmetic instead of ptr(row): the row may lie outside of the image.
  const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
  const unsigned char* const from = image.data + row * step + column;
  if (from == read_from_ && rows == rows_) return;
  read_from_ = from;
  rows_ = rows;
  const std::size_t columns = wholeChunks(layout_.stride);
  // At the end of the memory a row cannot be read in whole chunks.
  int whole = rows;
  while (whole > 0 && from + (whole - 1) * step + columns > image.datalimit) --whole;
  widen(from, image.step[0], whole, columns, layout_.stride, pixels_.data());
  for (int y = whole; y < rows; ++y) {
    const unsigned char* const begin = from + y * step;
    const auto left =
        static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, image.datalimit - begin));
    std::transform(begin, begin + std::min(columns, left),
                   pixels_.data() + static_cast<std::size_t>(y) * layout_.stride,
                   [](unsigned char grey) { return static_cast<Element>(grey * kGreyUnit); });
  }
}

void PixelWindow::interpolateRows(float b, std::size_t count) {
  interpolateAlong(pixels_.data(), layout_.stride, count + kPatchChunk, fixedPoint(b),
                   between_rows_.data());
}

void PixelWindow::interpolate(float a, float b, PatchArray* out) {
  const std::size_t count = wholeChunks(static_cast<std::size_t>(rows_ - 1) * layout_.stride);
  interpolateRows(b, count);
  interpolateAlong(between_rows_.data(), 1, count, fixedPoint(a), out->data());
}

Eigen::Vector2f PixelWindow::gradientTimesDifference(float a, float b, const GradientPatch& patch) {
  interpolateRows(b, layout_.count);
  Eigen::Vector2f sum = Eigen::Vector2f::Zero();
  forBlocks(layout_.count, [&](std::size_t begin, std::size_t count) {
    addGradientTimesDifference(between_rows_.data() + begin, fixedPoint(a),
                               patch.grey_.data() + begin, patch.x_.data() + begin,
                               patch.y_.data() + begin, count, &sum);
  });
  return sum;
}

}  // namespace ground_scale_vo
