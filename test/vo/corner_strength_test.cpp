#include "ground_scale_vo/vo/corner_strength.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {
namespace {

constexpr int kReach = CornerStrength::kReach;

/// Noise, blurred in the left half.
cv::Mat cornerTexture() {
  cv::Mat image(60, 131, CV_8UC1);
  cv::RNG generator(1);
  generator.fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::Mat left = image.colRange(0, 70);
  cv::GaussianBlur(left, left, {0, 0}, 1.5);
  return image;
}

TEST(CornerStrength, equalsOpenCvsMinimumEigenvalue) {
  const cv::Mat image = cornerTexture();
  cv::Mat expected;
  cv::cornerMinEigenVal(image, expected, 5, 3);
  CornerStrength strength(image, kReach);
  std::vector<float> row(static_cast<std::size_t>(image.cols));
  for (int y = kReach; y < image.rows - kReach; ++y) {
    std::fill(row.begin(), row.end(), -1.f);
    strength.next(row.data());
    for (int x = 0; x < image.cols; ++x) {
      const float value = x < kReach || x >= image.cols - kReach ? 0.f : expected.at<float>(y, x);
      ASSERT_NEAR(row[static_cast<std::size_t>(x)], value, 1e-6f + 1e-5f * value)
          << "row " << y << ", column " << x;
    }
  }
}

TEST(CornerStrength, doesNotDependOnTheFirstRow) {
  const cv::Mat image = cornerTexture();
  const auto size = static_cast<std::size_t>(image.cols);
  CornerStrength all(image, kReach), later(image, 20);
  std::vector<float> expected(size), row(size);
  for (int y = kReach; y <= 20; ++y) all.next(expected.data());
  later.next(row.data());
  EXPECT_EQ(row, expected);
}

TEST(CornerStrength, isZeroOnABlankImageAndLargestOnACheckerboard) {
  const cv::Mat blank(20, 20, CV_8UC1, cv::Scalar(90));
  std::vector<float> row(20);
  CornerStrength(blank, 10).next(row.data());
  EXPECT_EQ(row, std::vector<float>(20, 0.f));
  // Full contrast: no sum overflows.
  cv::Mat board(20, 20, CV_8UC1, cv::Scalar(0));
  board(cv::Rect(0, 0, 10, 10)) = 255;
  board(cv::Rect(10, 10, 10, 10)) = 255;
  CornerStrength(board, 10).next(row.data());
  cv::Mat expected;
  cv::cornerMinEigenVal(board, expected, 5, 3);
  EXPECT_NEAR(row[10], expected.at<float>(10, 10), 1e-5f);
  EXPECT_GT(row[10], 0.1f);
}

}  // namespace
}  // namespace ground_scale_vo
