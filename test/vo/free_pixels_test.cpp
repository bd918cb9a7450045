#include "vo/free_pixels.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {
namespace {

void expectSamePixels(const cv::Mat& actual, const cv::Mat& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  EXPECT_EQ(cv::countNonZero(actual != expected), 0);
}

// Also at the image border and outside: their discs are clipped.
TEST(FreePixels, RemovesThePixelsOfOpenCvsFilledCircle) {
  const cv::Size size(90, 61);
  for (const int radius : {4, 5, 7, 8, 16, 20}) {
    FreePixels free(size, {}, radius);
    cv::Mat expected(size, CV_8UC1, cv::Scalar(255));
    for (int y = -2 * radius; y < size.height + 2 * radius; y += radius + 3) {
      for (int x = -2 * radius; x < size.width + 2 * radius; x += 2 * radius - 1) {
        free.removeDisc({x, y});
        cv::circle(expected, {x, y}, radius, 0, cv::FILLED);
      }
    }
    ASSERT_GT(cv::countNonZero(expected), 0) << radius;
    expectSamePixels(free.mask(), expected);
  }
}

TEST(FreePixels, StartsWithTheAllowedPixels) {
  cv::Mat allowed(40, 50, CV_8UC1, cv::Scalar(255));
  allowed(cv::Rect(10, 5, 20, 30)) = 0;
  FreePixels free(allowed.size(), allowed, 6);
  expectSamePixels(free.mask(), allowed);
  const cv::Mat expected = allowed.clone();
  cv::circle(expected, {40, 20}, 6, 0, cv::FILLED);
  free.removeDisc({40, 20});
  expectSamePixels(free.mask(), expected);
  EXPECT_EQ(allowed.at<unsigned char>(20, 40), 255);
}

}  // namespace
}  // namespace ground_scale_vo
