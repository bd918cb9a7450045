#include "vo/corners.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "common/vector_loop.hpp"

namespace ground_scale_vo {
namespace {

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
    for (Gradients& gradients : gradients_) {
      gradients.x.assign(columns, 0);
      gradients.y.assign(columns, 0);
    }
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
  struct Gradients {
    std::vector<std::int16_t> x, y;
  };
  /// Adds the gradients of a row to the running sums and removes those of the row kSide above.
  void addRow(int row) {
    const int columns = image_.cols;
    filterDown(image_.ptr(row - 1), image_.ptr(row), image_.ptr(row + 1), columns, smooth_.data(),
               difference_.data());
    Gradients& added = gradients_[static_cast<std::size_t>(row % kStoredRows)];
    // Row - kSide.
    const Gradients& old = gradients_[static_cast<std::size_t>((row + 1) % kStoredRows)];
    std::int16_t* const x = added.x.data();
    std::int16_t* const y = added.y.data();
    filterAcross(smooth_.data(), difference_.data(), columns, x, y);
    addProducts(x, y, old.x.data(), old.y.data(), columns, xx_.data(), xy_.data(), yy_.data());
  }

  const cv::Mat image_;
  int row_;                                        ///< the next one
  std::array<Gradients, kStoredRows> gradients_;   ///< row y at y % kStoredRows
  std::vector<std::int16_t> smooth_, difference_;  ///< of three rows
  std::vector<std::int32_t> xx_, xy_, yy_;  ///< products of the gradients, summed over kSide rows
};

/// [px] The rows of the template are widened to a multiple of it: one or two vector registers.
constexpr int kBlock = 16;

/// Sets the pixels to 0 where the template, of whole blocks, is 0. step: between rows of pixels.
GSV_VECTOR_LOOP void keepBoth(const unsigned char* __restrict disc, int blocks, int rows,
                              std::size_t step, unsigned char* __restrict pixels) {
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < blocks * kBlock; ++x) pixels[x] &= disc[x];
    disc += blocks * kBlock;
    pixels += step;
  }
}

/// The pixels of an image at which a corner may be detected: the allowed ones without discs around
/// the features and the corners so far. Hundreds of discs are removed, and cv::circle() takes three
/// times as long: this copies their pixels from a template, and a margin in memory makes clipping
/// unnecessary.
class FreePixels {
 public:
  /// allowed: 8-bit, of the image's size, 0 at pixels that are not free; empty: all are free.
  /// radius: of the discs [px].
  FreePixels(const cv::Size& size, const cv::Mat& allowed, int radius) : radius_(radius) {
    const int side = 2 * radius + 1, width = (side + kBlock - 1) / kBlock * kBlock;
    disc_ = cv::Mat(side, width, CV_8UC1, cv::Scalar(255));
    cv::circle(disc_, {radius, radius}, radius, 0, cv::FILLED);
    // A disc around a centre `radius` outside the image still touches it.
    const int margin = 2 * radius;
    padded_.create(size.height + 2 * margin, size.width + 2 * margin + width - side, CV_8UC1);
    mask_ = padded_(cv::Rect({margin, margin}, size));
    if (allowed.empty()) {
      std::memset(padded_.data, 255, padded_.total());
    } else {
      allowed.copyTo(mask_);
    }
  }

  /// The same pixels as those of a filled cv::circle(). Its centre may be outside the image.
  void removeDisc(const cv::Point& centre) {
    if (centre.x < -radius_ || centre.x >= mask_.cols + radius_ || centre.y < -radius_ ||
        centre.y >= mask_.rows + radius_) {
      return;
    }
    const cv::Point corner = centre + cv::Point(radius_, radius_);  // in padded_: -radius + margin
    keepBoth(disc_.ptr(), disc_.cols / kBlock, disc_.rows, padded_.step,
             padded_.ptr(corner.y) + corner.x);
  }

  /// 8-bit, of the image's size, 0 at pixels that are not free.
  const cv::Mat& mask() const { return mask_; }

 private:
  int radius_;
  cv::Mat disc_;    ///< 0 in the disc, 255 around it
  cv::Mat padded_;  ///< the mask with its margin
  cv::Mat mask_;    ///< part of padded_
};

/// Instead of the strength of a pixel that is not free; less than any strength.
constexpr float kNotFree = -1;

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

/// Largest strength among the free (non-zero) pixels of each column of an area; kNotFree without
/// one. Strides: between rows.
GSV_VECTOR_LOOP void columnMaxima(const float* __restrict strength, std::size_t strength_stride,
                                  const unsigned char* __restrict free, std::size_t free_stride,
                                  int columns, int rows, float* __restrict maxima) {
  for (int x = 0; x < columns; ++x) maxima[x] = kNotFree;
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const float value = free[x] ? strength[x] : kNotFree;
      maxima[x] = value > maxima[x] ? value : maxima[x];
    }
    strength += strength_stride;
    free += free_stride;
  }
}

/// The strongest pixel of an area among those that are free (non-zero), if its strength is at least
/// `least`; the first of several. strength, free: of the same pixels. maxima: memory for a row.
std::optional<cv::Point> strongest(const cv::Mat& strength, const cv::Mat& free,
                                   const cv::Rect& area, double least, std::vector<float>* maxima) {
  maxima->resize(static_cast<std::size_t>(area.width));
  columnMaxima(strength.ptr<float>(area.y) + area.x, strength.step1(), free.ptr(area.y) + area.x,
               free.step1(), area.width, area.height, maxima->data());
  const float largest = *std::max_element(maxima->begin(), maxima->end());
  if (!(largest > kNotFree) || largest < least) return std::nullopt;
  cv::Point first = area.br();
  for (int x = area.x; x < area.br().x; ++x) {
    if ((*maxima)[static_cast<std::size_t>(x - area.x)] < largest) continue;
    int y = area.y;
    while (strength.at<float>(y, x) < largest || free.at<unsigned char>(y, x) == 0) ++y;
    if (y < first.y) first = {x, y};
  }
  return first;
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

std::vector<cv::Point2f> detectCorners(const cv::Mat& image, const cv::Mat& allowed,
                                       const std::vector<cv::Point2f>& occupied,
                                       const CornerCriteria& criteria) {
  const int cell = criteria.cell_px, border = criteria.border_px;
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
  FreePixels free(image.size(), allowed, cell / 2);
  for (const cv::Point2f& u : occupied) {
    const int index = cellOf(u);
    if (index >= 0) taken[static_cast<std::size_t>(index)] = 1;
    free.removeDisc(u);
  }

  CornerStrength strength(image, border - 1);
  cv::Mat band(cell + 2, image.cols, CV_32FC1);  // a row of cells with a border of 1 px
  int filled = 0;
  std::vector<float> maxima;
  std::vector<cv::Point2f> corners;
  for (int row = 0; row < rows; ++row) {
    for (; filled < band.rows; ++filled) strength.next(band.ptr<float>(filled));
    const int first_row = border + row * cell - 1;
    const cv::Mat free_band = free.mask().rowRange(first_row, first_row + band.rows);
    for (int column = 0; column < columns; ++column) {
      if (taken[static_cast<std::size_t>(row * columns + column)]) continue;
      const cv::Rect area(border + column * cell, 1, cell, cell);
      const std::optional<cv::Point> peak =
          strongest(band, free_band, area, criteria.min_strength, &maxima);
      // A maximum on the cell's border may belong to a stronger corner in the next cell.
      if (!peak || !isLocalMaximum(band, *peak)) continue;
      const cv::Point at = *peak + cv::Point(0, first_row);
      if (eigenvalueRatio(image, at, criteria.half_patch_px) < criteria.min_ratio) continue;
      corners.emplace_back(at);
      free.removeDisc(at);
    }
    // The last two rows are the first of the next band.
    band.rowRange(cell, cell + 2).copyTo(band.rowRange(0, 2));
    filled = 2;
  }
  return corners;
}

}  // namespace ground_scale_vo
