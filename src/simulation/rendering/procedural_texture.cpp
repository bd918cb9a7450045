#include "simulation/rendering/procedural_texture.hpp"

#include <algorithm>
#include <cmath>
#include <list>
#include <mutex>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo::simulation {
namespace {
constexpr int kShift = 4;  // fractional bits of coordinates in OpenCV's drawing functions
constexpr int kSubTexels = 1 << kShift;

/// Most drives of a process have the same seed, so that half of the noise of a world is that of the
/// one before. A world has about 25, of up to 4 MiB.
constexpr std::size_t kCachedNoises = 30;

using Layers = std::vector<std::pair<double, double>>;  // sigma, weight

cv::Mat newTileableNoise(cv::Size size, std::uint64_t seed, const Layers& sigma_weight) {
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

}  // namespace

cv::Mat tileableNoise(cv::Size size, std::uint64_t seed,
                      std::initializer_list<std::pair<double, double>> sigma_weight) {
  struct Entry {
    cv::Size size;
    std::uint64_t seed;
    Layers layers;
    cv::Mat noise;
  };
  static std::list<Entry> cache;  // the last used one comes first
  static std::mutex mutex;
  const Layers layers(sigma_weight);
  {
    const std::lock_guard<std::mutex> lock(mutex);
    const auto entry = std::find_if(cache.begin(), cache.end(), [&](const Entry& e) {
      return e.size == size && e.seed == seed && e.layers == layers;
    });
    if (entry != cache.end()) {
      cache.splice(cache.begin(), cache, entry);
      return entry->noise.clone();
    }
  }
  const cv::Mat noise = newTileableNoise(size, seed, layers);
  const std::lock_guard<std::mutex> lock(mutex);
  cache.push_front({size, seed, layers, noise});
  if (cache.size() > kCachedNoises) cache.pop_back();
  return noise.clone();
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
  cv::fillPoly(image_, points, grey, cv::LINE_AA, kShift);
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
              cv::FILLED, cv::LINE_AA, kShift);
}

}  // namespace ground_scale_vo::simulation
