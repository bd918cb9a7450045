#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "common/lanes.hpp"

namespace ground_scale_vo {

// Square patches of an odd number of pixels a side, the window, in floating-point numbers. A patch
// is stored row by row in a flat array with a stride of the window plus two columns. The loops run
// over the array without regard to rows, kLanes pixels at a time, and a mask removes the padding.
//
// Everything is inline, to become part of one GSV_VECTOR_LOOP. `Window` is int, or
// std::integral_constant, for which the compiler knows the lengths of the loops.

constexpr int kMaxWindow = 21;
constexpr std::size_t kMaxStride = kMaxWindow + 2;
constexpr std::size_t kMaxElements = kMaxStride * kMaxStride + 2 * kLanes;
using FloatPatch = std::array<float, kMaxElements>;

constexpr std::size_t strideOf(int window) { return static_cast<std::size_t>(window + 2); }
/// Elements of a patch with the padding.
constexpr std::size_t countOf(int window) {
  return wholeLanes(static_cast<std::size_t>(window) * strideOf(window));
}

/// Elements of a FloatWindow that compare() reads.
constexpr std::size_t windowCountOf(int window) { return countOf(window) + strideOf(window) + 1; }
static_assert(windowCountOf(kMaxWindow) <= kMaxElements);

/// Where the elements of the patches of one window are.
struct FloatPatchGrid {
  explicit FloatPatchGrid(int window) {
    const int stride = window + 2;
    for (int i = 0; i < stride * stride; ++i) {
      columns.push_back(static_cast<float>(i % stride));
      rows.push_back(static_cast<float>(i / stride - stride / 2));
      if (i < window * stride) mask.push_back(i % stride < window ? 1.f : 0.f);
    }
    for (std::vector<float>* values : {&columns, &rows, &mask}) {
      values->resize(wholeLanes(values->size()));
    }
  }

  /// Of a patch with a border of one pixel: from its first column, and from its middle row [px].
  std::vector<float> columns, rows;
  std::vector<float> mask;  ///< of a patch: 1 pixel of the window, 0 padding
};

/// Interpolates the image at u_ref + step * (x, y) for the pixels (x, y) of a patch with a border
/// of one pixel, from its centre. Precondition: these places and their right and lower neighbours
/// are inside the image.
template <typename Window>
void sample(Window window, const FloatPatchGrid& grid, const cv::Mat& image,
            const Eigen::Vector2f& u_ref, const Eigen::Matrix2f& step, FloatPatch* values) {
  const auto left = -static_cast<float>(window / 2 + 1);
  const std::size_t places = strideOf(window) * strideOf(window), count = wholeLanes(places);
  const auto image_step = static_cast<std::int32_t>(image.step[0]);
  FloatPatch a, b;  // fractions between pixels
  // Of the upper left pixel; then the upper two pixels and the lower two, the right one times 256.
  std::array<std::int32_t, kMaxElements> offset, upper, lower;
  for (std::size_t i = 0; i < count; i += kLanes) {
    const Lanes x = lanes(&grid.columns[i]), y = lanes(&grid.rows[i]);
    const Lanes at_x = u_ref.x() + (step(0, 0) * left + step(0, 1) * y) + x * step(0, 0);
    const Lanes at_y = u_ref.y() + (step(1, 0) * left + step(1, 1) * y) + x * step(1, 0);
    const IntLanes u = __builtin_convertvector(at_x, IntLanes);
    const IntLanes v = __builtin_convertvector(at_y, IntLanes);
    lanes(&a[i]) = at_x - __builtin_convertvector(u, Lanes);
    lanes(&b[i]) = at_y - __builtin_convertvector(v, Lanes);
    lanes(&offset[i]) = v * image_step + u;
  }
  for (std::size_t i = 0; i < places; ++i) {
    const unsigned char* const p = image.data + offset[i];
    const unsigned char* const q = p + image_step;
    upper[i] = p[0] | p[1] << 8;
    lower[i] = q[0] | q[1] << 8;
  }
  std::fill(upper.begin() + places, upper.begin() + count, 0);
  std::fill(lower.begin() + places, lower.begin() + count, 0);
  for (std::size_t i = 0; i < count; i += kLanes) {
    const IntLanes upper_left = lanes(&upper[i]) & 255, upper_right = lanes(&upper[i]) >> 8;
    const IntLanes lower_left = lanes(&lower[i]) & 255, lower_right = lanes(&lower[i]) >> 8;
    const Lanes above = __builtin_convertvector(upper_left, Lanes) +
                        lanes(&a[i]) * __builtin_convertvector(upper_right - upper_left, Lanes);
    const Lanes below = __builtin_convertvector(lower_left, Lanes) +
                        lanes(&a[i]) * __builtin_convertvector(lower_right - lower_left, Lanes);
    lanes(values->data() + i) = above + lanes(&b[i]) * (below - above);
  }
  std::fill_n(values->begin() + count, kLanes, 0.f);
}

/// A patch and its gradients, all with zero mean.
struct ZeroMeanPatch {
  FloatPatch grey, gx, gy;
  float squares;     ///< sum over grey
  float xx, xy, yy;  ///< sums of products of gradients
};

/// Sets the patch without the border of one pixel that `wide` has.
template <typename Window>
void differentiate(Window window, const float* mask, const FloatPatch& wide, ZeroMeanPatch* patch) {
  const std::size_t stride = strideOf(window), count = countOf(window);
  const auto pixels = static_cast<float>(window * window);
  Lanes grey_sum{}, x_sum{}, y_sum{};
  for (std::size_t i = 0; i < count; i += kLanes) {
    const float* const centre = &wide[i + stride + 1];
    const Lanes inside = lanes(mask + i);
    const Lanes value = lanes(centre) * inside;
    const Lanes x = 0.5f * (lanes(centre + 1) - lanes(centre - 1)) * inside;
    const Lanes y = 0.5f * (lanes(centre + stride) - lanes(centre - stride)) * inside;
    lanes(&patch->grey[i]) = value;
    lanes(&patch->gx[i]) = x;
    lanes(&patch->gy[i]) = y;
    grey_sum += value;
    x_sum += x;
    y_sum += y;
  }
  const float mean = total(grey_sum) / pixels;
  // The residual is zero-mean, so its derivative is the gradient minus the mean gradient.
  const float mean_x = total(x_sum) / pixels, mean_y = total(y_sum) / pixels;
  Lanes squares{}, xx{}, xy{}, yy{};
  for (std::size_t i = 0; i < count; i += kLanes) {
    const Lanes inside = lanes(mask + i);
    const Lanes value = lanes(&patch->grey[i]) - mean * inside;
    const Lanes x = lanes(&patch->gx[i]) - mean_x * inside;
    const Lanes y = lanes(&patch->gy[i]) - mean_y * inside;
    lanes(&patch->grey[i]) = value;
    lanes(&patch->gx[i]) = x;
    lanes(&patch->gy[i]) = y;
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
template <typename Window>
class FloatWindow {
 public:
  FloatWindow(Window window, const cv::Mat& image) : window_(window), image_(image) {
    std::fill_n(pixels_.begin(), windowCountOf(window), 0.f);
  }

  /// column, row: upper left pixel. Precondition: inside the image with one more row and column.
  void moveTo(int column, int row) {
    if (column == column_ && row == row_) return;
    column_ = column;
    row_ = row;
    const auto step = static_cast<std::ptrdiff_t>(image_.step[0]);
    const auto columns = static_cast<std::size_t>(window_ + 1);
    const unsigned char* from = image_.ptr(row) + column;
    float* to = pixels_.data();
    // At the end of the memory a row cannot be read in whole kLanes.
    const bool whole = from + window_ * step + wholeLanes(columns) <= image_.datalimit;
    for (int y = 0; y <= window_; ++y, from += step, to += strideOf(window_)) {
      if (whole) {
        std::copy_n(from, wholeLanes(columns), to);
      } else {
        std::copy_n(from, columns, to);
      }
    }
  }
  const float* data() const { return pixels_.data(); }

 private:
  const Window window_;
  const cv::Mat& image_;
  int column_ = -1, row_ = -1;
  FloatPatch pixels_;
};

/// Sums over the pixels of an image and a patch.
struct MatchSums {
  Lanes grey{}, squares{}, products{}, along_x{}, along_y{};
};

/// Compares a patch with pixels of a FloatWindow, interpolated at the fractions a and b of a pixel
/// to the right and down.
template <typename Window>
MatchSums compare(Window window, const float* mask, const float* pixels, float a, float b,
                  const ZeroMeanPatch& patch) {
  MatchSums sums;
  for (std::size_t i = 0; i < countOf(window); i += kLanes) {
    const float* const upper = pixels + i;
    const float* const lower = upper + strideOf(window);
    const Lanes left = lanes(upper) + b * (lanes(lower) - lanes(upper));
    const Lanes right = lanes(upper + 1) + b * (lanes(lower + 1) - lanes(upper + 1));
    const Lanes grey = (left + a * (right - left)) * lanes(mask + i);
    const Lanes difference = grey - lanes(&patch.grey[i]);
    sums.grey += grey;
    sums.squares += grey * grey;
    sums.products += grey * lanes(&patch.grey[i]);
    sums.along_x += lanes(&patch.gx[i]) * difference;
    sums.along_y += lanes(&patch.gy[i]) * difference;
  }
  return sums;
}

}  // namespace ground_scale_vo
