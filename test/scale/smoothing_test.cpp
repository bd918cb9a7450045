#include "scale/direct/smoothing.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::direct {
namespace {

/// Smooths the area and compares it with OpenCV's result.
void expectGaussian(const cv::Mat& source, const cv::Rect& area, double sigma) {
  Smoothing smoothing(sigma);
  const cv::Mat kernel = cv::getGaussianKernel(2 * smoothing.radius() + 1, sigma, CV_32F);
  cv::Mat expected, actual(area.size(), CV_32F);
  cv::sepFilter2D(source, expected, CV_32F, kernel, kernel);
  smoothing.smooth(source, area, &actual);
  EXPECT_LT(cv::norm(actual, expected(area), cv::NORM_INF), 1e-4) << area << ", " << sigma;
}

TEST(Smoothing, EqualsOpenCvsFilterInAnyPartOfAnImage) {
  cv::Mat image(30, 47, CV_8UC1), numbers;
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  image.convertTo(numbers, CV_32F, 0.7, 3);
  for (const double sigma : {0.6, 0.75, 1.15}) {
    for (const cv::Mat& source : {image, numbers}) {
      expectGaussian(source, {0, 0, 47, 30}, sigma);
      expectGaussian(source, {11, 9, 20, 7}, sigma);
      expectGaussian(source, {0, 22, 5, 8}, sigma);
      expectGaussian(source, {1, 2, 46, 27}, sigma);
      expectGaussian(source, {45, 0, 2, 30}, sigma);
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo::direct
