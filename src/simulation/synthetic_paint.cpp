#include "synthetic_paint.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::synthetic {
namespace {
constexpr int kShift = 4;  // fractional bits of OpenCV's drawing
constexpr int kSubTexels = 1 << kShift;
}  // namespace

double lit(const Eigen::Vector3d& normal, const Eigen::Vector3d& sun) {
  return 0.5 + 0.62 * std::max(0.0, normal.dot(sun));
}

cv::Mat noiseTile(cv::Size size, std::uint64_t seed,
                  std::initializer_list<std::pair<double, double>> sigma_weight) {
  cv::RNG rng(seed);
  cv::Mat sum = cv::Mat::zeros(size, CV_32F);
  for (const auto& [sigma, weight] : sigma_weight) {
    const int border = static_cast<int>(std::ceil(4 * sigma));
    cv::Mat white(size, CV_32F), wrapped, blurred;
    rng.fill(white, cv::RNG::NORMAL, 0, 1);
    cv::copyMakeBorder(white, wrapped, border, border, border, border, cv::BORDER_WRAP);
    cv::GaussianBlur(wrapped, blurred, {}, sigma);
    blurred = blurred(cv::Rect({border, border}, size));
    cv::Scalar mean, deviation;
    cv::meanStdDev(blurred, mean, deviation);
    sum += (blurred - mean[0]) * (weight / deviation[0]);
  }
  cv::Scalar mean, deviation;
  cv::meanStdDev(sum, mean, deviation);
  return (sum - mean[0]) / deviation[0];
}

cv::Mat grey(const cv::Mat& noise, double mean, double deviation) {
  cv::Mat image;
  noise.convertTo(image, CV_8U, deviation, mean);
  return image;
}

cv::Point Brush::point(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d at = (p / texel_m_ - Eigen::Vector2d(0.5, 0.5)) * kSubTexels;
  return {cvRound(at.x()), cvRound(at.y())};
}

void Brush::polygon(const std::vector<Eigen::Vector2d>& corners, double level) {
  std::vector<std::vector<cv::Point>> points(1);
  for (const Eigen::Vector2d& corner : corners) points[0].push_back(point(corner));
  cv::fillPoly(image_, points, level, cv::LINE_AA, kShift);
}

void Brush::box(double u, double v, double width, double height, double level) {
  polygon({{u, v}, {u + width, v}, {u + width, v + height}, {u, v + height}}, level);
}

void Brush::line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double width, double level) {
  const Eigen::Vector2d along = b - a;
  const Eigen::Vector2d side =
      Eigen::Vector2d(-along.y(), along.x()) * (width / 2 / std::max(along.norm(), 1e-9));
  polygon({a - side, b - side, b + side, a + side}, level);
}

void Brush::ellipse(const Eigen::Vector2d& centre, const Eigen::Vector2d& radii, double level) {
  const Eigen::Vector2d axes = radii / texel_m_ * kSubTexels;
  cv::ellipse(image_, point(centre), {cvRound(axes.x()), cvRound(axes.y())}, 0, 0, 360, level,
              cv::FILLED, cv::LINE_AA, kShift);
}

}  // namespace ground_scale_vo::synthetic
