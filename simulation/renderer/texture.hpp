#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <initializer_list>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

namespace gsv::simulation {

/// A grey texture with its mip levels. Texture coordinates (u, v) are in metres from the upper left
/// corner.
class Texture {
 public:
  enum class Wrap { kRepeat, kClamp };

  /// base: 8-bit, one channel; for kRepeat both sides are powers of two. texel_m: side of a texel.
  Texture(const cv::Mat& base, double texel_m, Wrap wrap);

  double width() const { return levels_[0].cols * texel_m_; }   ///< [m]
  double height() const { return levels_[0].rows * texel_m_; }  ///< [m]

  /// Anisotropic filter: the mean grey level over the ellipse that one pixel covers on the texture.
  /// J = d(u, v)/d(x, y) [m/px]. The samples lie along the major axis of the ellipse, on the mip
  /// level of its minor axis.
  float sample(const Eigen::Vector2d& uv, const Eigen::Matrix2d& J) const;

 private:
  /// x, y: in texels, from the centre of the upper left one.
  template <Wrap wrap>
  static float bilinear(const cv::Mat& image, double x, double y);
  /// The weighted mean of `count` samples around the centre, along the axis. centre, axis: in
  /// texels of the first level. level: mip level, interpolated.
  template <Wrap wrap>
  float meanAlong(const Eigen::Vector2d& centre, const Eigen::Vector2d& axis, int count,
                  double level) const;

  std::vector<cv::Mat> levels_;
  double texel_m_;
  Wrap wrap_;
};

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

}  // namespace gsv::simulation
