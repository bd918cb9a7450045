#include "vo/patch.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/vector_loop.hpp"

namespace ground_scale_vo {
namespace {

/// With more, patches on edges move along them; with fewer, those in a narrow field of view lag
/// behind.
constexpr int kMaxIterations = 20;
/// [px] step length at convergence: a fraction of the noise of an aligned corner (0.2 px).
constexpr float kConverged_px = 0.004f;
/// [px] two steps whose sum is below it in each coordinate go back and forth.
constexpr float kOscillation_px = 0.01f;
/// [grey levels^2 per px^2] least mean over the patch of the squared gradient in its weakest
/// direction.
constexpr float kMinSquaredGradient = 0.1f;
/// [grey levels^2] least sum of squared deviations from the mean, against a division by zero.
constexpr float kMinSquares = 1e-3f;

using Element = std::int16_t;
constexpr auto kSide = static_cast<std::size_t>(Patch::kSide);
constexpr std::size_t kStride = Patch::kStride;
constexpr int kPixels = Patch::kSide * Patch::kSide;

constexpr std::size_t wholeChunks(std::size_t count) {
  return (count + Patch::kChunk - 1) / Patch::kChunk * Patch::kChunk;
}
/// Elements of a patch with the padding between its rows.
constexpr std::size_t kCount = wholeChunks(kSide * kStride);

/// -1: pixel of the patch, 0: padding.
constexpr std::array<Element, kCount> kMask = [] {
  std::array<Element, kCount> mask{};
  for (std::size_t i = 0; i < kCount; ++i) {
    mask[i] = i % kStride < kSide && i / kStride < kSide ? -1 : 0;
  }
  return mask;
}();

constexpr int kGreyUnit = 32;      ///< value of one grey level
constexpr int kGradientUnit = 16;  ///< value of one grey level per pixel
/// Products of a difference of grey levels (at most 255 * kGreyUnit) and a gradient (127.5 *
/// kGradientUnit) of all pixels may be added in 32 bits.
static_assert(kCount * (255 * kGreyUnit) * (128 * kGradientUnit) < (std::size_t{1} << 31));

/// Upper left pixel of a patch, and the fractions to its position.
struct Corner {
  int column, row;
  float a, b;

  /// Precondition: finite, near an image.
  explicit Corner(const cv::Point2f& centre) {
    const float x = centre.x - static_cast<float>(Patch::kSide / 2);
    const float y = centre.y - static_cast<float>(Patch::kSide / 2);
    column = static_cast<int>(std::floor(x));
    row = static_cast<int>(std::floor(y));
    a = x - static_cast<float>(column);
    b = y - static_cast<float>(row);
  }
};

/// Whether a patch overlaps the image; false for coordinates that are not finite.
bool overlaps(const cv::Mat& image, const cv::Point2f& centre) {
  constexpr auto kHalf = static_cast<float>(Patch::kSide / 2),
                 kWidth = static_cast<float>(Patch::kSide);
  return centre.x - kHalf >= -kWidth && centre.x - kHalf < static_cast<float>(image.cols) &&
         centre.y - kHalf >= -kWidth && centre.y - kHalf < static_cast<float>(image.rows);
}

/// p + fraction * (q - p), rounded to the nearest: with rounding down, the tracks of faint features
/// drift. The fraction has 15 bits. Written such that gcc translates the product into one
/// instruction of AVX2 (pmulhrsw).
inline Element interpolated(Element p, Element q, Element fraction) {
  const auto difference = static_cast<Element>(q - p);
  const auto part = static_cast<Element>((((difference * std::int32_t{fraction}) >> 14) + 1) >> 1);
  return static_cast<Element>(p + part);
}
/// Between four neighbours, of which p is the upper left one.
inline Element interpolated(const Element* p, Element a, Element b) {
  return interpolated(interpolated(p[0], p[kStride], b), interpolated(p[1], p[kStride + 1], b), a);
}
inline Element fixedPoint(float fraction) { return static_cast<Element>(fraction * (1 << 15)); }

/// 3/16 outer + 10/16 inner + 3/16 outer (Scharr), rounded to kGradientUnit; the inputs are
/// differences over two pixels in kGreyUnit.
inline Element smoothed(Element outer_1, Element inner, Element outer_2) {
  constexpr std::int32_t kOuterWeight = 3 << 12;
  static_assert(2 * kGreyUnit == kGradientUnit << 2);
  const auto excess = static_cast<Element>(outer_1 + outer_2 - 2 * inner);
  const auto sum = static_cast<Element>(inner + ((excess * kOuterWeight) >> 16) + 2);
  return static_cast<Element>(sum >> 2);
}

/// The pixels of an image around a patch, in kGreyUnit.
class PixelWindow {
 public:
  /// Reads `rows` rows of pixels from (column, row) on, unless they were the last to be read.
  void read(const cv::Mat& image, int column, int row, int rows) {
    // Pointer arithmetic instead of ptr(row): the row may lie outside of the image.
    const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
    const unsigned char* from = image.data + row * step + column;
    if (from == read_from_) return;
    read_from_ = from;
    constexpr auto kReadColumns = static_cast<std::ptrdiff_t>(wholeChunks(kStride));
    Element* to = pixels_.data();
    if (from + (rows - 1) * step + kReadColumns <= image.datalimit) {
      for (int y = 0; y < rows; ++y, from += step, to += kStride) widen(from, kReadColumns, to);
    } else {  // At the end of the memory a row cannot be read in whole chunks.
      for (int y = 0; y < rows; ++y, from += step, to += kStride) {
        widen(from, std::clamp<std::ptrdiff_t>(image.datalimit - from, 0, kReadColumns), to);
      }
    }
  }
  const Element* data() const { return pixels_.data(); }

 private:
  static void widen(const unsigned char* __restrict from, std::ptrdiff_t count,
                    Element* __restrict to) {
    for (std::ptrdiff_t x = 0; x < count; ++x) to[x] = static_cast<Element>(from[x] * kGreyUnit);
  }

  Patch::Array pixels_{};
  const unsigned char* read_from_ = nullptr;
};

/// The patch with a border of one pixel.
GSV_VECTOR_LOOP __attribute__((flatten)) void readWide(const cv::Mat& image,
                                                       const cv::Point2f& centre,
                                                       Patch::Array* wide) {
  const Corner corner(centre);
  PixelWindow window;
  window.read(image, corner.column - 1, corner.row - 1, Patch::kSide + 3);
  const Element a = fixedPoint(corner.a), b = fixedPoint(corner.b);
  for (std::size_t i = 0; i < wholeChunks((kStride - 1) * kStride); ++i) {
    (*wide)[i] = interpolated(window.data() + i, a, b);
  }
}

/// The same with pixels at centre + step * (x, y), which must be inside the image.
void readWarped(const cv::Mat& image, const cv::Point2f& centre, const Eigen::Matrix2f& step,
                Patch::Array* wide) {
  constexpr int kReach = Patch::kSide / 2 + 1;
  constexpr float kUnit = 1 << 16;  // coordinates are fixed-point numbers
  const auto fixed = [](float value) { return static_cast<std::int32_t>(value * kUnit); };
  const std::int32_t dx = fixed(step(0, 0)), dy = fixed(step(1, 0));
  const auto image_step = static_cast<std::ptrdiff_t>(image.step[0]);
  for (int y = -kReach; y <= kReach; ++y) {
    std::int32_t u = fixed(centre.x + step(0, 1) * static_cast<float>(y)) - kReach * dx;
    std::int32_t v = fixed(centre.y + step(1, 1) * static_cast<float>(y)) - kReach * dy;
    Element* const row = wide->data() + static_cast<std::size_t>(y + kReach) * kStride;
    for (std::size_t x = 0; x < kSide + 2; ++x, u += dx, v += dy) {
      const unsigned char* const p = image.data + (v >> 16) * image_step + (u >> 16);
      const std::int32_t a = u & 0xffff, b = (v & 0xffff) >> 1;
      const std::int32_t upper = ((p[0] << 16) + (p[1] - p[0]) * a) >> 9;
      const std::int32_t lower =
          ((p[image_step] << 16) + (p[image_step + 1] - p[image_step]) * a) >> 9;
      static_assert(kGreyUnit == 1 << (16 - 9 + 15 - 17));
      row[x] = static_cast<Element>(((upper << 15) + (lower - upper) * b + (1 << 16)) >> 17);
    }
  }
}

/// Sums over the gradients of a patch.
struct GradientSums {
  std::int32_t x = 0, y = 0, xx = 0, xy = 0, yy = 0;
};

/// wide: the patch with a border of one pixel.
GSV_VECTOR_LOOP GradientSums differentiate(const Element* __restrict wide, Element* __restrict grey,
                                           Element* __restrict x, Element* __restrict y) {
  GradientSums sums;
  for (std::size_t i = 0; i < kCount; ++i) {
    const Element* const upper = wide + i;
    const Element* const middle = upper + kStride;
    const Element* const lower = middle + kStride;
    const auto gradient_x = smoothed(static_cast<Element>(upper[2] - upper[0]),
                                     static_cast<Element>(middle[2] - middle[0]),
                                     static_cast<Element>(lower[2] - lower[0]));
    const auto gradient_y = smoothed(static_cast<Element>(lower[0] - upper[0]),
                                     static_cast<Element>(lower[1] - upper[1]),
                                     static_cast<Element>(lower[2] - upper[2]));
    grey[i] = middle[1];
    x[i] = static_cast<Element>(gradient_x & kMask[i]);
    y[i] = static_cast<Element>(gradient_y & kMask[i]);
    sums.x += x[i];
    sums.y += y[i];
    sums.xx += x[i] * x[i];
    sums.xy += x[i] * y[i];
    sums.yy += y[i] * y[i];
  }
  return sums;
}

/// Sums over the differences d of an image, at the fractions (a, b) of a pixel, and a patch.
struct DifferenceSums {
  std::int32_t d = 0, xd = 0, yd = 0;
};

inline DifferenceSums compare(const Element* pixels, float a, float b, const Patch::Array& grey,
                              const Patch::Array& x, const Patch::Array& y) {
  const Element across = fixedPoint(a), down = fixedPoint(b);
  DifferenceSums sums;
  for (std::size_t i = 0; i < kCount; ++i) {
    const auto difference =
        static_cast<Element>((interpolated(pixels + i, across, down) - grey[i]) & kMask[i]);
    sums.d += difference;
    sums.xd += difference * x[i];
    sums.yd += difference * y[i];
  }
  return sums;
}

/// See Patch::find(). flatten: all that it calls becomes part of it, and so of its version for
/// AVX2.
GSV_VECTOR_LOOP __attribute__((flatten)) cv::Point2f minimise(
    const cv::Mat& image, const Patch::Array& grey, const Patch::Array& x, const Patch::Array& y,
    const Eigen::Vector2f& mean_gradient, const Eigen::Matrix2f& inverse_hessian,
    cv::Point2f point) {
  PixelWindow window;
  cv::Point2f previous_step;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!overlaps(image, point)) break;
    const Corner corner(point);
    window.read(image, corner.column, corner.row, Patch::kSide + 1);
    const DifferenceSums sums = compare(window.data(), corner.a, corner.b, grey, x, y);
    const Eigen::Vector2f product(static_cast<float>(sums.xd), static_cast<float>(sums.yd));
    const Eigen::Vector2f move =
        -inverse_hessian * (product - static_cast<float>(sums.d) * mean_gradient);
    const cv::Point2f step(move.x(), move.y());
    point += step;
    if (step.dot(step) <= kConverged_px * kConverged_px) break;
    const cv::Point2f sum = step + previous_step;
    if (iteration > 0 && std::max(std::abs(sum.x), std::abs(sum.y)) < kOscillation_px) {
      point -= step / 2;
      break;
    }
    previous_step = step;
  }
  return point;
}

}  // namespace

bool Patch::cut(const cv::Mat& image, const cv::Point2f& centre) {
  if (!overlaps(image, centre)) return false;
  Array wide;
  readWide(image, centre, &wide);
  return prepareSearch(wide);
}

bool Patch::cut(const cv::Mat& image, const cv::Point2f& centre, const Eigen::Matrix2f& step) {
  // To the outermost pixels with the border for the gradients, and their neighbours.
  const float reach =
      static_cast<float>(kSide / 2 + 1) * step.cwiseAbs().rowwise().sum().maxCoeff() + 1;
  if (!(centre.x >= reach && centre.y >= reach &&
        centre.x + reach < static_cast<float>(image.cols - 1) &&
        centre.y + reach < static_cast<float>(image.rows - 1))) {
    return false;
  }
  Array wide{};
  readWarped(image, centre, step, &wide);
  return prepareSearch(wide);
}

bool Patch::prepareSearch(const Array& wide) {
  const GradientSums sums =
      differentiate(wide.data(), grey_.data(), gradient_x_.data(), gradient_y_.data());
  const Eigen::Vector2f sum(static_cast<float>(sums.x), static_cast<float>(sums.y));
  Eigen::Matrix2f hessian;
  hessian << static_cast<float>(sums.xx), static_cast<float>(sums.xy), static_cast<float>(sums.xy),
      static_cast<float>(sums.yy);
  hessian -= sum * sum.transpose() / kPixels;
  mean_gradient_ = sum / kPixels;
  const float radius = std::hypot(hessian(0, 0) - hessian(1, 1), 2 * hessian(0, 1));
  const float smaller_eigenvalue = (hessian.trace() - radius) / 2;
  if (!(smaller_eigenvalue >=
        kMinSquaredGradient * static_cast<float>(kPixels * kGradientUnit * kGradientUnit))) {
    return false;
  }
  inverse_hessian_ = hessian.inverse() * (static_cast<float>(kGradientUnit) / kGreyUnit);
  return true;
}

bool Patch::find(const cv::Mat& image, float max_distance, cv::Point2f* point) const {
  const cv::Point2f guess = *point;
  *point =
      minimise(image, grey_, gradient_x_, gradient_y_, mean_gradient_, inverse_hessian_, guess);
  const cv::Point2f offset = *point - guess;
  return overlaps(image, *point) && offset.dot(offset) <= max_distance * max_distance;
}

float Patch::correlation(const cv::Mat& image, const cv::Point2f& point) const {
  Array wide;
  readWide(image, point, &wide);
  std::int32_t a = 0, b = 0;
  std::int64_t aa = 0, ab = 0, bb = 0;
  for (std::size_t y = 0; y < kSide; ++y) {
    const Element* const row_a = &grey_[y * kStride];
    const Element* const row_b = &wide[(y + 1) * kStride + 1];
    for (std::size_t x = 0; x < kSide; ++x) {
      a += row_a[x];
      b += row_b[x];
      aa += row_a[x] * row_a[x];
      ab += row_a[x] * row_b[x];
      bb += row_b[x] * row_b[x];
    }
  }
  const auto covariance = [](std::int64_t product, std::int32_t p, std::int32_t q) {
    return static_cast<float>(product - static_cast<std::int64_t>(p) * q / kPixels);
  };
  const float least = kMinSquares * kGreyUnit * kGreyUnit;
  return covariance(ab, a, b) /
         std::sqrt(std::max(least, covariance(aa, a, a)) * std::max(least, covariance(bb, b, b)));
}

void Patch::prefetch(const cv::Mat& image, const cv::Point2f& centre) {
  if (!overlaps(image, centre)) return;
  const Corner corner(centre);
  const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
  const unsigned char* row = image.data + (corner.row - 1) * step + corner.column - 1;
  for (std::size_t y = 0; y < kStride; ++y, row += step) {
    __builtin_prefetch(row);
    __builtin_prefetch(row + kStride - 1);
  }
}

cv::Mat withBorder(const cv::Mat& image) {
  constexpr int kBorder = Patch::kBorder;
  cv::Mat padded;
  cv::copyMakeBorder(image, padded, kBorder, kBorder, kBorder, kBorder,
                     cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
  return padded({{kBorder, kBorder}, image.size()});
}

}  // namespace ground_scale_vo
