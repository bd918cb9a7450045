#include "ground_scale_vo/vo/corner_strength.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace ground_scale_vo {
namespace {

/// Scale of one gradient as in cv::cornerMinEigenVal: sum of the Sobel weights (4), side of the
/// summation window (5), grey levels (255). The gradient matrix has its square.
constexpr float kGradientScale = 1.f / (4 * 5 * 255);

using Row = std::vector<std::int16_t>;

/// Adds a * b to the sums and subtracts old_a * old_b. One product per loop: gcc does not vectorise
/// a loop over all three.
void addProducts(const Row& a, const Row& b, const Row& old_a, const Row& old_b,
                 std::vector<std::int32_t>* sums) {
  for (std::size_t x = 0; x < sums->size(); ++x) {
    (*sums)[x] += a[x] * b[x] - old_a[x] * old_b[x];
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
  const unsigned char* const above = image_.ptr(row - 1);
  const unsigned char* const here = image_.ptr(row);
  const unsigned char* const below = image_.ptr(row + 1);
  std::int16_t* const smooth = smooth_.data();
  std::int16_t* const difference = difference_.data();
  for (int x = 0; x < image_.cols; ++x) {
    smooth[x] = static_cast<std::int16_t>(above[x] + 2 * here[x] + below[x]);
    difference[x] = static_cast<std::int16_t>(below[x] - above[x]);
  }
  Gradients& added = gradients_[static_cast<std::size_t>(row % kStoredRows)];
  // Row - kSide.
  const Gradients& old = gradients_[static_cast<std::size_t>((row + 1) % kStoredRows)];
  std::int16_t* const gx = added.x.data();
  std::int16_t* const gy = added.y.data();
  for (int x = 1; x < image_.cols - 1; ++x) {
    gx[x] = static_cast<std::int16_t>(smooth[x + 1] - smooth[x - 1]);
    gy[x] = static_cast<std::int16_t>(difference[x - 1] + 2 * difference[x] + difference[x + 1]);
  }
  addProducts(added.x, added.x, old.x, old.x, &xx_);
  addProducts(added.x, added.y, old.x, old.y, &xy_);
  addProducts(added.y, added.y, old.y, old.y, &yy_);
}

void CornerStrength::next(float* strength) {
  addRow(row_ + kSide / 2);
  ++row_;
  const std::int32_t* const xx = xx_.data();
  const std::int32_t* const xy = xy_.data();
  const std::int32_t* const yy = yy_.data();
  const auto across = [](const std::int32_t* sums) {
    return sums[-2] + sums[-1] + sums[0] + sums[1] + sums[2];
  };
  const int end = image_.cols - kReach;
  std::fill(strength, strength + kReach, 0.f);
  std::fill(strength + end, strength + image_.cols, 0.f);
  for (int x = kReach; x < end; ++x) {
    const std::int32_t a = across(xx + x), b = across(xy + x), c = across(yy + x);
    const auto sum = static_cast<float>(a + c), difference = static_cast<float>(a - c),
               mixed = static_cast<float>(2 * b);
    const float root = std::sqrt(difference * difference + mixed * mixed);
    strength[x] = 0.5f * kGradientScale * kGradientScale * (sum - root);
  }
}

}  // namespace ground_scale_vo
