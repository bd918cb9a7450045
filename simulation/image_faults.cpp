#include "simulation/image_faults.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "simulation/renderer/random.hpp"
#include "simulation/renderer/texture.hpp"

namespace gsv {
namespace {

using simulation::Random;

constexpr double kDarkGain = 0.4, kBrightGain = 2.5;  // factors on the grey level
constexpr double kFlickerGain = 1.8;                  // largest; the smallest is its inverse
constexpr double kCoverGain = 0.12;                   // factor on the grey level
constexpr double kCoverBlur = 0.08;  // half the side of the box filter [share of the image width]
constexpr double kNoise = 1;         // of the sensor, standard deviation [grey levels]
constexpr double kClearHeight = 1.0 / 3;    // share of the image height above the mud
constexpr double kMudEdge = 0.02;           // width of its soft edge [share of the image width]
constexpr int kStreaks = 160, kDrops = 14;  // in every image

/// The random numbers of image k.
Random generator(std::uint64_t seed, std::size_t k) { return Random(seed * 0x9E3779B9u + k + 1); }

void addNoise(cv::Mat* image, Random* random) {
  cv::RNG rng(random->bits());
  cv::Mat noise(image->size(), CV_16S);
  rng.fill(noise, cv::RNG::NORMAL, 0, kNoise);
  cv::add(*image, noise, *image, cv::noArray(), CV_8U);
}

cv::Mat withGain(const cv::Mat& image, double gain) {
  cv::Mat result;
  image.convertTo(result, CV_8U, gain);
  return result;
}

cv::Mat covered(const cv::Mat& image, Random random) {
  cv::Mat result;
  cv::blur(image, result, cv::Size(1, 1) * (2 * static_cast<int>(kCoverBlur * image.cols) + 1));
  result = withGain(result, kCoverGain);
  addNoise(&result, &random);
  return result;
}

/// transparency(x, y): 1 where the lens is clean, 0 behind mud; clamped.
template <typename Transparency>
cv::Mat muddy(const cv::Mat& image, std::uint64_t seed, std::size_t k,
              const Transparency& transparency) {
  const cv::Mat mud = simulation::noiseToGrey(
      simulation::tileableNoise(image.size(), seed,
                                {{0.01 * image.cols, 1}, {0.03 * image.cols, 1}}),
      60, 9);
  cv::Mat result = image.clone();
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const double clear = std::clamp(transparency(x, y), 0.0, 1.0);
      const double dirt = mud.at<uchar>(y, x);
      result.at<uchar>(y, x) =
          cv::saturate_cast<uchar>(clear * image.at<uchar>(y, x) + (1 - clear) * dirt);
    }
  }
  Random random = generator(seed, k);
  addNoise(&result, &random);
  return result;
}

cv::Mat rainy(const cv::Mat& image, std::uint64_t seed, std::size_t k) {
  cv::Mat result = image.clone();
  Random random = generator(seed, k);
  const double length = 0.05 * image.cols;
  for (int i = 0; i < kStreaks; ++i) {
    const double y = random.uniform(-length, image.rows), x = random.uniform(0, image.cols);
    const double dy = random.uniform(0.3, 1) * length, dx = random.uniform(0.05, 0.15) * length;
    const cv::Point2d top(x, y), streak(dx, dy);
    cv::line(result, top, top + streak, cv::Scalar(random.uniform(170, 235)), 1, cv::LINE_AA);
  }
  // A drop on the lens is modelled as a blurred disc that creeps down.
  cv::Mat blurred;
  cv::blur(image, blurred, cv::Size(1, 1) * (2 * (image.cols / 40) + 1));
  Random drops = generator(seed, 0x10000);  // the same drops in every image
  for (int i = 0; i < kDrops; ++i) {
    const double radius = drops.uniform(0.01, 0.03) * image.cols;
    const double x = drops.uniform(0, image.cols), y = drops.uniform(0, image.rows);
    const double creeps = drops.uniform(0, 0.004) * image.cols * static_cast<double>(k);
    cv::Mat drop = cv::Mat::zeros(image.size(), CV_8U);
    cv::circle(drop, cv::Point2d(x, std::fmod(y + creeps, image.rows)), static_cast<int>(radius),
               cv::Scalar(255), cv::FILLED);
    blurred.copyTo(result, drop);
  }
  return result;
}

}  // namespace

cv::Mat withFault(FaultKind kind, const cv::Mat& image, std::size_t k, std::uint64_t seed) {
  const double edge = kMudEdge * image.cols;
  switch (kind) {
    case FaultKind::kBlack:
      return cv::Mat::zeros(image.size(), CV_8U);
    case FaultKind::kWhite:
      return cv::Mat(image.size(), CV_8U, cv::Scalar(255));
    case FaultKind::kFrozen:
      return image;
    case FaultKind::kCovered:
      return covered(image, generator(seed, k));
    case FaultKind::kCoveredBelow:
      return muddy(image, seed, k,
                   [&](int, int y) { return (kClearHeight * image.rows - y) / edge; });
    case FaultKind::kCoveredLeft:
      return muddy(image, seed, k, [&](int x, int) { return (x - 0.5 * image.cols) / edge; });
    case FaultKind::kRain:
      return rainy(image, seed, k);
    case FaultKind::kDarker:
      return withGain(image, kDarkGain);
    case FaultKind::kBrighter:
      return withGain(image, kBrightGain);
    case FaultKind::kFlicker:
      return withGain(image, std::pow(kFlickerGain, generator(seed, k).uniform(-1, 1)));
  }
  return image;
}

}  // namespace gsv
