#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <initializer_list>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

namespace ground_scale_vo::synthetic {

/// Light on a surface of this unit normal, 1 = full. sun: unit vector towards it.
double lit(const Eigen::Vector3d& normal, const Eigen::Vector3d& sun);

/// Noise of mean 0 and deviation 1 that repeats itself: white noise blurred by each sigma [px].
cv::Mat noiseTile(cv::Size size, std::uint64_t seed,
                  std::initializer_list<std::pair<double, double>> sigma_weight);

/// 8-bit picture of a noise.
cv::Mat grey(const cv::Mat& noise, double mean, double deviation);

/// Draws in metres on a picture whose upper left corner is (0, 0); edges are smooth.
class Brush {
 public:
  Brush(cv::Mat image, double texel_m) : image_(std::move(image)), texel_m_(texel_m) {}
  void polygon(const std::vector<Eigen::Vector2d>& corners, double level);
  void box(double u, double v, double width, double height, double level);
  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double width, double level);
  void ellipse(const Eigen::Vector2d& centre, const Eigen::Vector2d& radii, double level);

 private:
  cv::Point point(const Eigen::Vector2d& p) const;
  cv::Mat image_;  ///< shares its pixels with the caller's
  double texel_m_;
};

}  // namespace ground_scale_vo::synthetic
