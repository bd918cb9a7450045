#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <initializer_list>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

namespace ground_scale_vo::simulation {

/// A weighted sum of white noise, blurred by each sigma [px]. It tiles seamlessly. CV_32F, mean 0,
/// standard deviation 1.
cv::Mat tileableNoise(cv::Size size, std::uint64_t seed,
                      std::initializer_list<std::pair<double, double>> sigma_weight);

/// The 8-bit image mean + contrast * noise, saturated; mean and contrast in grey levels.
cv::Mat noiseToGrey(const cv::Mat& noise, double mean, double contrast);

/// Draws filled, anti-aliased shapes of one grey level into a texture image. Coordinates and
/// lengths are in metres, the origin is the upper left corner.
class TexturePainter {
 public:
  /// image: shared, not copied.
  TexturePainter(cv::Mat image, double texel_m) : image_(std::move(image)), texel_m_(texel_m) {}
  void polygon(const std::vector<Eigen::Vector2d>& corners, double grey);
  /// (u, v): upper left corner.
  void box(double u, double v, double width, double height, double grey);
  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double width, double grey);
  void ellipse(const Eigen::Vector2d& centre, const Eigen::Vector2d& radii, double grey);

 private:
  cv::Point fixedPoint(const Eigen::Vector2d& p) const;
  cv::Mat image_;
  double texel_m_;
};

}  // namespace ground_scale_vo::simulation
