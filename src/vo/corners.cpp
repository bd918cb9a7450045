#include "vo/corners.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "common/vector_loop.hpp"
#include "vo/lucas_kanade.hpp"

namespace gsv {
namespace {

/// [px] Pixels nearer to the image border have no corner strength.
constexpr int kCornerReach = 3;
/// [px] from a corner at a whole pixel to the last pixel on which its strength or its tracked
/// patch, with gradients, depends.
constexpr int kCornerBorder = std::max(kTrackedSide / 2, kCornerReach) + 1;
/// [px] least side of a grid cell: corners nearer to each other share most of their patches.
constexpr int kMinCell_px = 8;
/// [px] Corners are detected in the finest level of the pyramid that has at most as many pixels: in
/// a larger one the time grows, the number of cells does not.
constexpr std::size_t kMaxDetection_px = 1'500'000;

/// Scale of one gradient as in cv::cornerMinEigenVal: sum of the Sobel weights (4), side of the
/// summation window (5), grey levels (255). The gradient matrix has its square.
constexpr float kGradientScale = 1.f / (4 * 5 * 255);

/// The vertical part of the Sobel filters: sums and differences of three rows of pixels.
GSV_VECTOR_LOOP void filterDown(const unsigned char* __restrict above,
                                const unsigned char* __restrict here,
                                const unsigned char* __restrict below, int columns,
                                std::int16_t* __restrict smooth,
                                std::int16_t* __restrict difference) {
  for (int x = 0; x < columns; ++x) {
    smooth[x] = static_cast<std::int16_t>(above[x] + 2 * here[x] + below[x]);
    difference[x] = static_cast<std::int16_t>(below[x] - above[x]);
  }
}

/// The horizontal part; leaves the first and the last column.
GSV_VECTOR_LOOP void filterAcross(const std::int16_t* __restrict smooth,
                                  const std::int16_t* __restrict difference, int columns,
                                  std::int16_t* __restrict gx, std::int16_t* __restrict gy) {
  for (int x = 1; x < columns - 1; ++x) {
    gx[x] = static_cast<std::int16_t>(smooth[x + 1] - smooth[x - 1]);
    gy[x] = static_cast<std::int16_t>(difference[x - 1] + 2 * difference[x] + difference[x + 1]);
  }
}

/// Adds the products of the gradients of a row to the sums and subtracts those of an old row.
GSV_VECTOR_LOOP void addProducts(const std::int16_t* __restrict x, const std::int16_t* __restrict y,
                                 const std::int16_t* __restrict old_x,
                                 const std::int16_t* __restrict old_y, int columns,
                                 std::int32_t* __restrict xx, std::int32_t* __restrict xy,
                                 std::int32_t* __restrict yy) {
  for (int i = 0; i < columns; ++i) {
    xx[i] += x[i] * x[i] - old_x[i] * old_x[i];
    xy[i] += x[i] * y[i] - old_x[i] * old_y[i];
    yy[i] += y[i] * y[i] - old_y[i] * old_y[i];
  }
}

/// The smaller eigenvalue of each gradient matrix, summed across the window. Leaves kCornerReach
/// columns on both sides.
GSV_VECTOR_LOOP void smallerEigenvalues(const std::int32_t* __restrict xx,
                                        const std::int32_t* __restrict xy,
                                        const std::int32_t* __restrict yy, int columns,
                                        float* __restrict strength) {
  const auto across = [](const std::int32_t* sums) {
    return sums[-2] + sums[-1] + sums[0] + sums[1] + sums[2];
  };
  for (int x = kCornerReach; x < columns - kCornerReach; ++x) {
    const std::int32_t a = across(xx + x), b = across(xy + x), c = across(yy + x);
    const auto sum = static_cast<float>(a + c), difference = static_cast<float>(a - c),
               mixed = static_cast<float>(2 * b);
    const float root = std::sqrt(difference * difference + mixed * mixed);
    strength[x] = 0.5f * kGradientScale * kGradientScale * (sum - root);
  }
}

/// Shi-Tomasi corner strength, row by row: the smaller eigenvalue of the gradient matrix around
/// each pixel, with Sobel gradients summed over a square of 5 px, as in
/// cv::cornerMinEigenVal(image, ..., 5, 3). The running sums are integers, hence exact, and fit
/// into the cache.
class CornerStrength {
 public:
  /// image: 8-bit grey, shared, not copied. first_row: the row of the first call of next().
  /// Precondition: kCornerReach <= first_row, and at least 2 kCornerReach columns.
  CornerStrength(const cv::Mat& image, int first_row) : image_(image), row_(first_row) {
    const auto columns = static_cast<std::size_t>(image.cols);
    gradients_x_.fill(std::vector<std::int16_t>(columns, 0));
    gradients_y_ = gradients_x_;
    smooth_.resize(columns);
    difference_.resize(columns);
    for (auto* sums : {&xx_, &xy_, &yy_}) sums->assign(columns, 0);
    for (int row = first_row - kSide / 2; row < first_row + kSide / 2; ++row) addRow(row);
  }

  /// Writes the strength of the next row, for grey levels in [0, 1]: one float per image column.
  /// Precondition: the row is at least kCornerReach above the last.
  void next(float* strength) {
    addRow(row_ + kSide / 2);
    ++row_;
    std::fill(strength, strength + kCornerReach, 0.f);
    std::fill(strength + image_.cols - kCornerReach, strength + image_.cols, 0.f);
    smallerEigenvalues(xx_.data(), xy_.data(), yy_.data(), image_.cols, strength);
  }

 private:
  static constexpr int kSide = 5;                ///< [px]
  static constexpr int kStoredRows = kSide + 1;  ///< the window and the row that it leaves
  /// Adds the gradients of a row to the running sums and removes those of the row kSide above.
  void addRow(int row) {
    const int columns = image_.cols;
    filterDown(image_.ptr(row - 1), image_.ptr(row), image_.ptr(row + 1), columns, smooth_.data(),
               difference_.data());
    const auto added = static_cast<std::size_t>(row % kStoredRows);
    const auto old = static_cast<std::size_t>((row + 1) % kStoredRows);  // row - kSide
    std::int16_t* const x = gradients_x_[added].data();
    std::int16_t* const y = gradients_y_[added].data();
    filterAcross(smooth_.data(), difference_.data(), columns, x, y);
    addProducts(x, y, gradients_x_[old].data(), gradients_y_[old].data(), columns, xx_.data(),
                xy_.data(), yy_.data());
  }

  const cv::Mat image_;
  int row_;  ///< the next one
  /// Row y at y % kStoredRows.
  std::array<std::vector<std::int16_t>, kStoredRows> gradients_x_, gradients_y_;
  std::vector<std::int16_t> smooth_, difference_;  ///< of three rows
  std::vector<std::int32_t> xx_, xy_, yy_;  ///< products of the gradients, summed over kSide rows
};

/// Smaller over larger eigenvalue of the gradient matrix of the patch around a pixel: 0 on a
/// straight edge, where the aperture problem leaves the position along the edge undetermined.
double eigenvalueRatio(const cv::Mat& image, const cv::Point& at, int half) {
  int xx = 0, xy = 0, yy = 0;  // at most 51 x 51 squares of 255
  for (int y = std::max(1, at.y - half); y <= std::min(image.rows - 2, at.y + half); ++y) {
    const unsigned char* above = image.ptr(y - 1);
    const unsigned char* row = image.ptr(y);
    const unsigned char* below = image.ptr(y + 1);
    for (int x = std::max(1, at.x - half); x <= std::min(image.cols - 2, at.x + half); ++x) {
      const int gx = row[x + 1] - row[x - 1], gy = below[x] - above[x];
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  const double mean = 0.5 * (xx + yy), radius = std::hypot(0.5 * (xx - yy), xy);
  return mean > 0 ? (mean - radius) / (mean + radius) : 0;
}

/// The strongest pixel of an area among those that are free (non-zero), if its strength is at least
/// `least`; the first of several. strength, free: of the same pixels.
std::optional<cv::Point> strongest(const cv::Mat& strength, const cv::Mat& free,
                                   const cv::Rect& area, double least) {
  double largest = 0;
  cv::Point at;
  cv::minMaxLoc(strength(area), nullptr, &largest, nullptr, &at, free(area));
  if (at.x < 0 || largest < least) return std::nullopt;
  return at + area.tl();
}

/// Whether none of the eight neighbours is stronger.
bool isLocalMaximum(const cv::Mat& strength, const cv::Point& at) {
  const float here = strength.at<float>(at);
  for (int y = at.y - 1; y <= at.y + 1; ++y) {
    const float* const values = strength.ptr<float>(y);
    if (std::max({values[at.x - 1], values[at.x], values[at.x + 1]}) > here) return false;
  }
  return true;
}

}  // namespace

CornerDetector::CornerDetector(const OdometryOptions& options, const cv::Mat& mask)
    : options_(options) {
  constexpr int kSquare = 2 * kCornerBorder + 1;
  if (!mask.empty()) cv::erode(mask, allowed_, cv::Mat::ones(kSquare, kSquare, CV_8U));
}

std::vector<cv::Point2f> CornerDetector::detect(const ImagePyramid& image,
                                                const std::vector<cv::Point2f>& occupied) const {
  std::size_t level = 0;
  while (level + 1 < image.levels.size() && image.levels[level].total() > kMaxDetection_px) {
    ++level;
  }
  if (level == 0) return detectIn(image.image, allowed_, occupied);
  const auto scale = static_cast<float>(1 << level);
  cv::Mat allowed;
  if (!allowed_.empty()) {
    cv::resize(allowed_, allowed, image.levels[level].size(), 0, 0, cv::INTER_NEAREST);
  }
  std::vector<cv::Point2f> scaled = occupied;
  for (cv::Point2f& u : scaled) u /= scale;
  std::vector<cv::Point2f> corners = detectIn(image.levels[level], allowed, scaled);
  for (cv::Point2f& u : corners) u *= scale;
  return corners;
}

std::vector<cv::Point2f> CornerDetector::detectIn(const cv::Mat& image, const cv::Mat& allowed,
                                                  const std::vector<cv::Point2f>& occupied) const {
  constexpr int border = kCornerBorder;
  const int cell =
      std::max(kMinCell_px, static_cast<int>(std::lround(options_.cell_size * image.cols)));
  const int columns = (image.cols - 2 * border) / cell;
  const int rows = (image.rows - 2 * border) / cell;
  if (columns < 1 || rows < 1) return {};

  const auto cellOf = [&](const cv::Point2f& u) {
    const int column =
        static_cast<int>((u.x - static_cast<float>(border)) / static_cast<float>(cell));
    const int row = static_cast<int>((u.y - static_cast<float>(border)) / static_cast<float>(cell));
    return column >= 0 && column < columns && row >= 0 && row < rows ? row * columns + column : -1;
  };
  std::vector<unsigned char> taken(static_cast<std::size_t>(columns * rows), 0);
  // 0 at pixels that are not allowed or near a feature.
  cv::Mat free =
      allowed.empty() ? cv::Mat(image.size(), CV_8UC1, cv::Scalar(255)) : allowed.clone();
  const auto occupy = [&](const cv::Point& centre) {
    cv::circle(free, centre, cell / 2, 0, cv::FILLED);
  };
  for (const cv::Point2f& u : occupied) {
    const int index = cellOf(u);
    if (index >= 0) taken[static_cast<std::size_t>(index)] = 1;
    occupy(u);
  }

  CornerStrength strength(image, border - 1);
  cv::Mat band(cell + 2, image.cols, CV_32FC1);  // a row of cells with a border of 1 px
  int filled = 0;
  std::vector<cv::Point2f> corners;
  for (int row = 0; row < rows; ++row) {
    for (; filled < band.rows; ++filled) strength.next(band.ptr<float>(filled));
    const int first_row = border + row * cell - 1;
    const cv::Mat free_band = free.rowRange(first_row, first_row + band.rows);
    for (int column = 0; column < columns; ++column) {
      if (taken[static_cast<std::size_t>(row * columns + column)]) continue;
      const cv::Rect area(border + column * cell, 1, cell, cell);
      const std::optional<cv::Point> peak =
          strongest(band, free_band, area, options_.min_corner_strength);
      // A maximum on the cell's border may belong to a stronger corner in the next cell.
      if (!peak || !isLocalMaximum(band, *peak)) continue;
      const cv::Point at = *peak + cv::Point(0, first_row);
      if (eigenvalueRatio(image, at, kTrackedSide / 2) < options_.min_corner_ratio) continue;
      corners.emplace_back(at);
      occupy(at);
    }
    // The last two rows are the first of the next band.
    band.rowRange(cell, cell + 2).copyTo(band.rowRange(0, 2));
    filled = 2;
  }
  return corners;
}

}  // namespace gsv
