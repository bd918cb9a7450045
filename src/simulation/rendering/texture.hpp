#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace ground_scale_vo::simulation {

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

}  // namespace ground_scale_vo::simulation
