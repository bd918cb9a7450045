#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>

#include "support/road_scene.hpp"

namespace gsv {

/// Value noise in [-1, 1] whose lattice has a spacing of `size`; deterministic in x, z and seed.
inline double smoothNoise(double x, double z, double size, std::uint64_t seed) {
  const auto corner = [seed](double i, double j) {
    std::uint64_t state =
        static_cast<std::uint64_t>(static_cast<std::int64_t>(i)) * 0x9E3779B97F4A7C15ull +
        static_cast<std::uint64_t>(static_cast<std::int64_t>(j)) * 0xC2B2AE3D27D4EB4Full + seed;
    state = (state ^ (state >> 31)) * 0xBF58476D1CE4E5B9ull;
    state = (state ^ (state >> 29)) * 0x94D049BB133111EBull;
    return static_cast<double>(state >> 11) * 0x1p-52 - 1;
  };
  const double i = std::floor(x / size), j = std::floor(z / size);
  const auto ease = [](double t) { return t * t * (3 - 2 * t); };
  const double a = ease(x / size - i), b = ease(z / size - j);
  return (1 - b) * ((1 - a) * corner(i, j) + a * corner(i + 1, j)) +
         b * ((1 - a) * corner(i, j + 1) + a * corner(i + 1, j + 1));
}

/// Texture of a road [grey levels] at (x, z) [camera heights].
inline double asphalt(double x, double z) {
  return 110 + 30 * smoothNoise(x, z, 0.5, 1) + 30 * smoothNoise(x, z, 0.15, 2);
}

/// Image of the RoadScene's camera at distance `at` along the road [VO units], dark above the
/// horizon. texture: grey level at (x, z) on the road [camera heights].
inline cv::Mat roadImage(const RoadScene& scene, double at,
                         const std::function<double(double, double)>& texture = asphalt) {
  constexpr int kSamples = 2;  // along a pixel's side
  cv::Mat image(scene.camera.height, scene.camera.width, CV_8U, cv::Scalar(30));
  const Eigen::Matrix3d R_r_c = scene.rotation();
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      double sum = 0;
      for (int k = 0; k < kSamples * kSamples; ++k) {
        const Eigen::Vector2d pixel(u + (k % kSamples + 0.5) / kSamples - 0.5,
                                    v + (k / kSamples + 0.5) / kSamples - 0.5);
        const Eigen::Vector3d ray = R_r_c * scene.camera.ray(pixel);
        if (ray.y() < 0.01) {
          sum += 30;
          continue;
        }
        sum += texture(ray.x() / ray.y(), ray.z() / ray.y() + at / scene.height);
      }
      image.at<std::uint8_t>(v, u) =
          static_cast<std::uint8_t>(std::clamp(sum / (kSamples * kSamples) + 0.5, 0.0, 255.0));
    }
  }
  return image;
}

}  // namespace gsv
