#include "vo/corner_detection.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {
namespace {

constexpr int kReach = CornerStrength::kReach;

/// Expects all rows from `first` on to be those of OpenCV, apart from the columns at the border.
void compareWithOpenCv(const cv::Mat& image, int first) {
  cv::Mat expected;
  cv::cornerMinEigenVal(image, expected, 5, 3);
  CornerStrength strength(image, first);
  std::vector<float> row(static_cast<std::size_t>(image.cols));
  for (int y = first; y < image.rows - kReach; ++y) {
    std::fill(row.begin(), row.end(), -1.f);
    strength.next(row.data());
    for (int x = 0; x < image.cols; ++x) {
      const float value = x < kReach || x >= image.cols - kReach ? 0.f : expected.at<float>(y, x);
      ASSERT_NEAR(row[static_cast<std::size_t>(x)], value, 1e-6f + 1e-5f * value)
          << "row " << y << ", column " << x;
    }
  }
}

TEST(CornerStrength, EqualsOpenCvsMinimumEigenvalue) {
  cv::Mat image(60, 131, CV_8UC1);  // noise, blurred in the left half
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::Mat left = image.colRange(0, 70);
  cv::GaussianBlur(left, left, {0, 0}, 1.5);
  for (const int first : {kReach, 20}) compareWithOpenCv(image, first);
  // Without contrast, and with full contrast: no sum overflows.
  cv::Mat board(40, 40, CV_8UC1, cv::Scalar(90));
  compareWithOpenCv(board, kReach);
  for (int y = 0; y < board.rows; ++y) {
    for (int x = 0; x < board.cols; ++x) {
      board.at<unsigned char>(y, x) = (x / 10 + y / 10) % 2 == 0 ? 0 : 255;
    }
  }
  compareWithOpenCv(board, kReach);
}

}  // namespace
}  // namespace ground_scale_vo
