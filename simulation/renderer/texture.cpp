#include "simulation/renderer/texture.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "common/vector_loop.hpp"

namespace gsv::simulation {
namespace {

// For coordinates in OpenCV's drawing functions.
constexpr int kFractionalBits = 4, kSubTexels = 1 << kFractionalBits;

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

template <Texture::Wrap wrap>
float Texture::bilinear(const cv::Mat& image, double x, double y) {
  const double left = std::floor(x), top = std::floor(y);
  int x0 = static_cast<int>(left), y0 = static_cast<int>(top), x1 = x0 + 1, y1 = y0 + 1;
  const auto dx = static_cast<float>(x - left), dy = static_cast<float>(y - top);
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
  float sum = 0, sum_of_weights = 0;
  for (int k = 0; k < count; ++k) {
    const double t = (k + 0.5) / count - 0.5;
    const auto weight = static_cast<float>(1 - 3 * t * t);  // falls off towards the ends
    const double x = (centre.x() + t * axis.x()) * levels_texel;
    const double y = (centre.y() + t * axis.y()) * levels_texel;
    float grey = bilinear<wrap>(image, x - 0.5, y - 0.5);
    if (blend > 0) grey += blend * (bilinear<wrap>(coarse, x / 2 - 0.5, y / 2 - 0.5) - grey);
    sum += weight * grey;
    sum_of_weights += weight;
  }
  return sum / sum_of_weights;
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

cv::Mat tileableNoise(cv::Size size, std::uint64_t seed,
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

cv::Mat noiseToGrey(const cv::Mat& noise, double mean, double contrast) {
  cv::Mat image;
  noise.convertTo(image, CV_8U, contrast, mean);
  return image;
}

cv::Point TexturePainter::fixedPoint(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d at = (p / texel_m_ - Eigen::Vector2d(0.5, 0.5)) * kSubTexels;
  return {cvRound(at.x()), cvRound(at.y())};
}

void TexturePainter::polygon(const std::vector<Eigen::Vector2d>& corners, double grey) {
  std::vector<std::vector<cv::Point>> points(1);
  for (const Eigen::Vector2d& corner : corners) points[0].push_back(fixedPoint(corner));
  cv::fillPoly(image_, points, grey, cv::LINE_AA, kFractionalBits);
}

void TexturePainter::box(double u, double v, double width, double height, double grey) {
  polygon({{u, v}, {u + width, v}, {u + width, v + height}, {u, v + height}}, grey);
}

void TexturePainter::line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double width,
                          double grey) {
  const Eigen::Vector2d along = b - a;
  const Eigen::Vector2d side =
      Eigen::Vector2d(-along.y(), along.x()) * (width / 2 / std::max(along.norm(), 1e-9));
  polygon({a - side, b - side, b + side, a + side}, grey);
}

void TexturePainter::ellipse(const Eigen::Vector2d& centre, const Eigen::Vector2d& radii,
                             double grey) {
  const Eigen::Vector2d axes = radii / texel_m_ * kSubTexels;
  cv::ellipse(image_, fixedPoint(centre), {cvRound(axes.x()), cvRound(axes.y())}, 0, 0, 360, grey,
              cv::FILLED, cv::LINE_AA, kFractionalBits);
}

}  // namespace gsv::simulation
