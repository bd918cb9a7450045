#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace gsv::test {

/// Blurred noise over the full range of grey levels.
inline cv::Mat blurredNoise(std::uint64_t seed, cv::Size size = {800, 248}, double blur_px = 2) {
  cv::Mat image(size, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, blur_px);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

/// Waves of amplitude 60 in one direction and of amplitude `across` in the other, along the image
/// axes or turned by 45 degrees. Without waves across, the image has edges but no corners.
inline cv::Mat waves(double across, bool turned) {
  cv::Mat image(248, 800, CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const double a = turned ? (u + v) * M_SQRT1_2 : u, b = turned ? (u - v) * M_SQRT1_2 : v;
      image.at<unsigned char>(v, u) = cv::saturate_cast<unsigned char>(
          120 + 60 * std::sin(0.7 * a) + across * std::sin(0.7 * b));
    }
  }
  return image;
}

/// The image after a rotation about its centre, a change of size and a shift.
inline cv::Mat moved(const cv::Mat& image, double dx, double dy, double degrees = 0,
                     double factor = 1) {
  cv::Mat M = cv::getRotationMatrix2D(
      {static_cast<float>(image.cols) / 2, static_cast<float>(image.rows) / 2}, degrees, factor);
  M.at<double>(0, 2) += dx;
  M.at<double>(1, 2) += dy;
  cv::Mat result;
  cv::warpAffine(image, result, M, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  return result;
}

/// All pixels of a grid inside an image, at this distance from its border.
inline std::vector<cv::Point2f> gridPixels(const cv::Size& size, int border, int step) {
  std::vector<cv::Point2f> points;
  for (int y = border; y < size.height - border; y += step) {
    for (int x = border; x < size.width - border; x += step) points.emplace_back(x, y);
  }
  return points;
}

}  // namespace gsv::test
