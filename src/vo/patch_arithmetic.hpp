#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace ground_scale_vo {

// Square patches in 16-bit integers. They are stored row by row in flat arrays; the loops run over
// an array without regard to rows, so that the compiler vectorises them, and the gradients are zero
// in the padding between rows. Sums of up to 128 products are exact integers, and are added as
// floating-point numbers in a fixed order: the results do not depend on the instruction set.

constexpr int kGreyUnit = 32;      ///< value of one grey level
constexpr int kGradientUnit = 16;  ///< value of one grey level per pixel

constexpr int kMaxPatchSide = 51;
/// [px] that gradients and interpolation between pixels need around a patch, both sides together.
constexpr int kPatchBorder = 3;
/// The loops process whole chunks: one or two vector registers.
constexpr std::size_t kPatchChunk = 16;

/// How the patches of one size are stored.
struct PatchLayout {
  explicit PatchLayout(int side_px);  ///< Precondition: odd, at most kMaxPatchSide

  int side;              ///< [px]
  std::size_t stride;    ///< elements from a row to the next
  std::size_t count;     ///< elements of a patch with the padding, whole chunks
  std::size_t elements;  ///< of an array: a patch with its border, and what loops access beyond it
  std::vector<std::int16_t> mask;  ///< -1: pixel of the patch, 0: padding
};

/// Upper left pixel of a patch, and the fractions to its position.
struct PatchCorner {
  int column, row;
  float a, b;
};
inline PatchCorner cornerOf(const Eigen::Vector2f& centre, const PatchLayout& layout) {
  const Eigen::Array2f corner = centre.array() - static_cast<float>(layout.side / 2);
  const Eigen::Array2f pixel = corner.floor();
  return {static_cast<int>(pixel.x()), static_cast<int>(pixel.y()), corner.x() - pixel.x(),
          corner.y() - pixel.y()};
}

/// A patch with a border, at the layout's stride.
class PatchArray {
 public:
  explicit PatchArray(const PatchLayout& layout) {
    std::fill_n(values_.begin(), layout.elements, std::int16_t{0});
  }
  std::int16_t* data() { return values_.data(); }
  const std::int16_t* data() const { return values_.data(); }

 private:
  static constexpr std::size_t kSide = kMaxPatchSide + kPatchBorder;
  std::array<std::int16_t, kSide * kSide + 2 * kPatchChunk> values_;
};

/// Sums of products over the pixels of a patch [kGradientUnit^2].
struct GradientSums {
  float xx = 0, xy = 0, yy = 0;
};

/// The grey levels of a patch and their gradients (Scharr).
class GradientPatch {
 public:
  explicit GradientPatch(const PatchLayout& layout)
      : layout_(layout), grey_(layout), x_(layout), y_(layout) {}

  /// wide: the patch with a border of one pixel.
  GradientSums set(const PatchArray& wide);

 private:
  friend class PixelWindow;
  const PatchLayout& layout_;
  PatchArray grey_, x_, y_;
};

/// Pixels of an image around a patch, and their values between pixels.
class PixelWindow {
 public:
  explicit PixelWindow(const PatchLayout& layout)
      : layout_(layout), pixels_(layout), between_rows_(layout) {}

  /// Reads `rows` rows and columns of pixels from (column, row) on, unless they were the last to be
  /// read. Precondition: they are pixels of the image or of the larger one that contains it, and
  /// the images do not change.
  void read(const cv::Mat& image, int column, int row, int rows);

  /// The pixels shifted by the fractions (a, b) of a pixel, 0 <= a, b < 1: one row less.
  void interpolate(float a, float b, PatchArray* out);

  /// Sums of gradient times difference of the pixels shifted by (a, b) from the patch
  /// [kGreyUnit * kGradientUnit].
  Eigen::Vector2f gradientTimesDifference(float a, float b, const GradientPatch& patch);

 private:
  void interpolateRows(float b, std::size_t count);

  const PatchLayout& layout_;
  PatchArray pixels_, between_rows_;
  const unsigned char* read_from_ = nullptr;
  int rows_ = 0;
};

}  // namespace ground_scale_vo
