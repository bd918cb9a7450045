#include "vo/patch_arithmetic.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {
namespace {

cv::Mat noise(int rows, int columns, int seed) {
  cv::Mat image(rows, columns, CV_8UC1);
  cv::RNG generator(static_cast<std::uint64_t>(seed));
  generator.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

double greyAt(const cv::Mat& image, double x, double y) {
  const int u = cvFloor(x), v = cvFloor(y);
  const double a = x - u, b = y - v;
  const auto at = [&](int du, int dv) { return image.at<unsigned char>(v + dv, u + du); };
  return (1 - b) * ((1 - a) * at(0, 0) + a * at(1, 0)) + b * ((1 - a) * at(0, 1) + a * at(1, 1));
}

/// The same sums in floating point, without fixed-point rounding.
struct Expected {
  double xx = 0, xy = 0, yy = 0;    // products of gradients
  double along_x = 0, along_y = 0;  // gradient times difference
  double squares = 0;               // of the differences
};
Expected expected(const cv::Mat& from, const cv::Point2d& p, const cv::Mat& to,
                  const cv::Point2d& q, int side) {
  Expected sums;
  for (int dy = -side / 2; dy <= side / 2; ++dy) {
    for (int dx = -side / 2; dx <= side / 2; ++dx) {
      const auto grey = [&](int i, int j) { return greyAt(from, p.x + dx + i, p.y + dy + j); };
      const double gx = (3 * (grey(1, -1) - grey(-1, -1)) + 10 * (grey(1, 0) - grey(-1, 0)) +
                         3 * (grey(1, 1) - grey(-1, 1))) /
                        32;
      const double gy = (3 * (grey(-1, 1) - grey(-1, -1)) + 10 * (grey(0, 1) - grey(0, -1)) +
                         3 * (grey(1, 1) - grey(1, -1))) /
                        32;
      const double d = greyAt(to, q.x + dx, q.y + dy) - grey(0, 0);
      sums.xx += gx * gx;
      sums.xy += gx * gy;
      sums.yy += gy * gy;
      sums.along_x += gx * d;
      sums.along_y += gy * d;
      sums.squares += d * d;
    }
  }
  return sums;
}

/// Compares all sums for a patch around p of one image and around q of another.
template <typename Layout>
void compareWith(const Layout& layout, const cv::Mat& from, const cv::Point2f& p, const cv::Mat& to,
                 const cv::Point2f& q) {
  const int side = layout.side;
  SCOPED_TRACE("side " + std::to_string(side));
  PixelWindow window;
  PatchArray wide{};
  GradientPatch patch;
  const PatchCorner origin = cornerOf(p, side);
  window.read(layout, from, origin.column - 1, origin.row - 1, side + 3);
  window.interpolate(layout, origin.a, origin.b, &wide);
  const GradientSums gradients = patch.set(layout, wide);
  const PatchCorner corner = cornerOf(q, side);
  window.read(layout, to, corner.column, corner.row, side + 1);
  const Eigen::Vector2f sums = window.gradientTimesDifference(layout, corner.a, corner.b, patch);

  const Expected e = expected(from, p, to, q, side);
  constexpr double kGradient = kGradientUnit, kProduct = kGradientUnit * kGreyUnit;
  // Every grey level and gradient is rounded, by less than 0.1 grey levels.
  const double pixels = side * side;
  const double strength = std::sqrt(pixels * (e.xx + e.yy));
  EXPECT_NEAR(gradients.xx / (kGradient * kGradient), e.xx, 0.1 * strength);
  EXPECT_NEAR(gradients.xy / (kGradient * kGradient), e.xy, 0.1 * strength);
  EXPECT_NEAR(gradients.yy / (kGradient * kGradient), e.yy, 0.1 * strength);
  const double change = 0.1 * (strength + std::sqrt(pixels * e.squares));
  EXPECT_NEAR(sums.x() / kProduct, e.along_x, change);
  EXPECT_NEAR(sums.y() / kProduct, e.along_y, change);
}

void compare(const cv::Mat& from, const cv::Point2f& p, const cv::Mat& to, const cv::Point2f& q,
             int side) {
  compareWith(PatchLayout(side), from, p, to, q);
  if (side == 9) compareWith(FixedPatchLayout<9>(), from, p, to, q);
}

TEST(PatchArithmetic, equalsFloatingPointForEverySize) {
  const cv::Mat from = noise(80, 90, 1), to = noise(80, 90, 2);
  for (int side = 5; side <= kMaxPatchSide; side += 2) {
    compare(from, {40.3f, 39.8f}, to, {41.71f, 38.24f}, side);
    compare(from, {40, 39}, to, {41, 38}, side);
  }
}

// The largest differences and gradients: stripes of two pixels, which a shift by two pixels turns
// into their negative. Shifted by one pixel, all products have the same sign: the largest sums.
TEST(PatchArithmetic, doesNotOverflow) {
  cv::Mat stripes(120, 120, CV_8UC1);
  for (int x = 0; x < stripes.cols; ++x) stripes.col(x) = x % 4 < 2 ? 0 : 255;
  for (const int side : {9, 21, kMaxPatchSide}) {
    compare(stripes, {50, 50}, stripes, {52, 50}, side);
    compare(stripes.t(), {50, 50}, stripes.t(), {50, 52}, side);
    compare(stripes, {50, 50}, stripes, {51, 50}, side);
    compare(stripes.t(), {50, 50}, stripes.t(), {50, 51}, side);
  }
}

TEST(PatchArithmetic, readsUpToTheEndOfTheMemory) {
  for (const int side : {5, 9, 15, 17}) {
    // The patches with their neighbours reach the last pixel of the last row.
    const cv::Mat image = noise(2 * side, 2 * side, side);
    const float last = static_cast<float>(2 * side - side / 2) - 1.5f;
    compare(image, {last - 1, last - 1}, image, {last, last}, side);
  }
}

}  // namespace
}  // namespace ground_scale_vo
