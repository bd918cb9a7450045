#include "ground_scale_vo/vo/corner_strength.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

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

/// The smaller eigenvalue of each gradient matrix, summed across the window. Leaves kReach columns
/// on both sides.
GSV_VECTOR_LOOP void smallerEigenvalues(const std::int32_t* __restrict xx,
                                        const std::int32_t* __restrict xy,
                                        const std::int32_t* __restrict yy, int columns,
                                        float* __restrict strength) {
  const auto across = [](const std::int32_t* sums) {
    return sums[-2] + sums[-1] + sums[0] + sums[1] + sums[2];
  };
  for (int x = CornerStrength::kReach; x < columns - CornerStrength::kReach; ++x) {
    const std::int32_t a = across(xx + x), b = across(xy + x), c = across(yy + x);
    const auto sum = static_cast<float>(a + c), difference = static_cast<float>(a - c),
               mixed = static_cast<float>(2 * b);
    const float root = std::sqrt(difference * difference + mixed * mixed);
    strength[x] = 0.5f * kGradientScale * kGradientScale * (sum - root);
  }
}

}  // namespace

CornerStrength::CornerStrength(const cv::Mat& image, int first_row)
    : image_(image), row_(first_row) {
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

/// Adds the gradients of a row to the running sums and removes those of the row kSide above.
void CornerStrength::addRow(int row) {
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

void CornerStrength::next(float* strength) {
  addRow(row_ + kSide / 2);
  ++row_;
  std::fill(strength, strength + kReach, 0.f);
  std::fill(strength + image_.cols - kReach, strength + image_.cols, 0.f);
  smallerEigenvalues(xx_.data(), xy_.data(), yy_.data(), image_.cols, strength);
}

}  // namespace ground_scale_vo
