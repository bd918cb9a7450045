#include "simulation/rendering/texture.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::simulation {
namespace {

constexpr int kMaxAnisotropy = 16;  // samples along the major axis of a footprint

}  // namespace

Texture::Texture(const cv::Mat& base, double texel_m, Wrap wrap)
    : levels_{base}, texel_m_(texel_m), wrap_(wrap) {
  while (levels_.back().cols % 2 == 0 && levels_.back().rows % 2 == 0) {
    cv::Mat half;
    cv::resize(levels_.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
    levels_.push_back(half);
  }
}

float Texture::bilinear(std::size_t level, double x, double y) const {
  const cv::Mat& image = levels_[level];
  const double fx = std::floor(x), fy = std::floor(y);
  const auto dx = static_cast<float>(x - fx), dy = static_cast<float>(y - fy);
  int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy), x1 = x0 + 1, y1 = y0 + 1;
  if (wrap_ == Wrap::kRepeat) {
    x0 &= image.cols - 1, x1 &= image.cols - 1;
    y0 &= image.rows - 1, y1 &= image.rows - 1;
  } else {
    x0 = std::clamp(x0, 0, image.cols - 1), x1 = std::clamp(x1, 0, image.cols - 1);
    y0 = std::clamp(y0, 0, image.rows - 1), y1 = std::clamp(y1, 0, image.rows - 1);
  }
  const std::uint8_t *upper = image.ptr(y0), *lower = image.ptr(y1);
  const float a = upper[x0] + dx * static_cast<float>(upper[x1] - upper[x0]);
  const float b = lower[x0] + dx * static_cast<float>(lower[x1] - lower[x0]);
  return a + dy * (b - a);
}

float Texture::sample(const Eigen::Vector2d& uv, const Eigen::Matrix2d& J) const {
  // The footprint of the pixel: eigenvalues and first eigenvector of J J^T, in texels.
  const Eigen::Matrix2d A = J * J.transpose() / (texel_m_ * texel_m_);
  const double mean = A.trace() / 2, difference = (A(0, 0) - A(1, 1)) / 2;
  const double root = std::hypot(difference, A(0, 1));
  const double major = std::sqrt(mean + root), minor = std::sqrt(std::max(mean - root, 0.0));
  const int count =
      std::clamp(static_cast<int>(std::ceil(major / std::max(minor, 1.0))), 1, kMaxAnisotropy);
  Eigen::Vector2d axis = difference > 0 ? Eigen::Vector2d(difference + root, A(0, 1))
                                        : Eigen::Vector2d(A(0, 1), root - difference);
  // The samples extend over 1.25 times the footprint, because their weights fall off towards its
  // ends.
  axis *= axis.squaredNorm() > 0 ? 1.25 * major / axis.norm() : 0;

  const double level = std::clamp(std::log2(std::max({minor, major / count, 1.0})), 0.0,
                                  static_cast<double>(levels_.size()) - 1);
  const auto fine = static_cast<std::size_t>(level);
  const auto blend = static_cast<float>(level - static_cast<double>(fine));
  const Eigen::Vector2d centre = uv / texel_m_;
  float sum = 0, weights = 0;
  for (int k = 0; k < count; ++k) {
    const double t = (k + 0.5) / count - 0.5;
    const auto weight = static_cast<float>(1 - 3 * t * t);
    const Eigen::Vector2d at = (centre + t * axis) / static_cast<double>(1 << fine);
    float grey = bilinear(fine, at.x() - 0.5, at.y() - 0.5);
    if (blend > 0) {
      grey += blend * (bilinear(fine + 1, at.x() / 2 - 0.5, at.y() / 2 - 0.5) - grey);
    }
    sum += weight * grey;
    weights += weight;
  }
  return sum / weights;
}

}  // namespace ground_scale_vo::simulation
