#include "simulation/rendering/texture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "common/vector_loop.hpp"

namespace ground_scale_vo::simulation {
namespace {

constexpr int kMaxAnisotropy = 16;  // samples along the major axis of a footprint

/// Samples along the axis of a footprint: positions from -0.5 to 0.5, and weights that fall off
/// towards the ends.
struct AxisSamples {
  std::array<double, kMaxAnisotropy> position;
  std::array<float, kMaxAnisotropy> weight;
  float sum_of_weights = 0;
};

/// count: 1 to kMaxAnisotropy.
const AxisSamples& axisSamples(int count) {
  static const std::array<AxisSamples, kMaxAnisotropy> all = [] {
    std::array<AxisSamples, kMaxAnisotropy> samples;
    for (int n = 1; n <= kMaxAnisotropy; ++n) {
      AxisSamples& s = samples[static_cast<std::size_t>(n - 1)];
      for (int k = 0; k < n; ++k) {
        const double t = (k + 0.5) / n - 0.5;
        const auto i = static_cast<std::size_t>(k);
        s.position[i] = t;
        s.weight[i] = static_cast<float>(1 - 3 * t * t);
        s.sum_of_weights += s.weight[i];
      }
    }
    return samples;
  }();
  return all[static_cast<std::size_t>(count - 1)];
}

/// The largest integer that is not greater than x; without SSE 4.1 faster than std::floor().
int floorToInt(double x) {
  const int truncated = static_cast<int>(x);
  return truncated - static_cast<int>(truncated > x);
}

}  // namespace

Texture::Texture(const cv::Mat& base, double texel_m, Wrap wrap)
    : levels_{base}, texel_m_(texel_m), wrap_(wrap) {
  while (levels_.back().cols % 2 == 0 && levels_.back().rows % 2 == 0) {
    cv::Mat half;
    cv::resize(levels_.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
    levels_.push_back(half);
  }
}

template <Texture::Wrap wrap>
float Texture::bilinear(const cv::Mat& image, double x, double y) {
  int x0 = floorToInt(x), y0 = floorToInt(y), x1 = x0 + 1, y1 = y0 + 1;
  const auto dx = static_cast<float>(x - x0), dy = static_cast<float>(y - y0);
  const int last_column = image.cols - 1, last_row = image.rows - 1;
  if constexpr (wrap == Wrap::kRepeat) {
    x0 &= last_column, x1 &= last_column;
    y0 &= last_row, y1 &= last_row;
  } else {
    x0 = std::clamp(x0, 0, last_column), x1 = std::clamp(x1, 0, last_column);
    y0 = std::clamp(y0, 0, last_row), y1 = std::clamp(y1, 0, last_row);
  }
  const std::uint8_t *upper = image.ptr(y0), *lower = image.ptr(y1);
  const float a = upper[x0] + dx * static_cast<float>(upper[x1] - upper[x0]);
  const float b = lower[x0] + dx * static_cast<float>(lower[x1] - lower[x0]);
  return a + dy * (b - a);
}

template <Texture::Wrap wrap>
float Texture::meanAlong(const Eigen::Vector2d& centre, const Eigen::Vector2d& axis, int count,
                         double level) const {
  const auto fine = static_cast<std::size_t>(level);
  const auto blend = static_cast<float>(level - static_cast<double>(fine));
  const cv::Mat &image = levels_[fine], &coarse = levels_[std::min(fine + 1, levels_.size() - 1)];
  const double levels_texel = 1.0 / static_cast<double>(1 << fine);
  const AxisSamples& samples = axisSamples(count);
  float sum = 0;
  for (int k = 0; k < count; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const double x = (centre.x() + samples.position[i] * axis.x()) * levels_texel;
    const double y = (centre.y() + samples.position[i] * axis.y()) * levels_texel;
    float grey = bilinear<wrap>(image, x - 0.5, y - 0.5);
    if (blend > 0) grey += blend * (bilinear<wrap>(coarse, x / 2 - 0.5, y / 2 - 0.5) - grey);
    sum += samples.weight[i] * grey;
  }
  return sum / samples.sum_of_weights;
}

__attribute__((flatten)) GSV_VECTOR_LOOP float Texture::sample(const Eigen::Vector2d& uv,
                                                               const Eigen::Matrix2d& J) const {
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
  const Eigen::Vector2d centre = uv / texel_m_;
  return wrap_ == Wrap::kRepeat ? meanAlong<Wrap::kRepeat>(centre, axis, count, level)
                                : meanAlong<Wrap::kClamp>(centre, axis, count, level);
}

}  // namespace ground_scale_vo::simulation
