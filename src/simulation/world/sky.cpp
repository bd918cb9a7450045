#include <algorithm>
#include <cmath>

#include "simulation/rendering/procedural_texture.hpp"
#include "simulation/world/world_builder.hpp"

namespace ground_scale_vo::simulation {

/// A panorama: clouds above wooded hills on the horizon.
void addSky(WorldBuilder& builder) {
  constexpr int kColumns = 4096, kRows = 512;
  cv::Mat image(kRows, kColumns, CV_8U);
  const cv::Mat clouds = tileableNoise({1024, 512}, builder.random.bits(), {{12, 0.5}, {40, 1}});
  const cv::Mat wood = tileableNoise({1024, 512}, builder.random.bits(), {{1.5, 1}, {5, 0.6}});
  const double phase = builder.uniform(0, 6);
  const double texel = 2 * M_PI / kColumns;  // [rad]
  for (int x = 0; x < kColumns; ++x) {
    const double azimuth = x * texel;
    const double skyline = 0.035 + 0.018 * std::sin(3 * azimuth + phase) +
                           0.01 * std::sin(8 * azimuth + 2 * phase) +
                           0.0015 * wood.at<float>(7, x % 1024);
    for (int y = 0; y < kRows; ++y) {
      const double elevation = kSkyTop - y * texel;
      const double sky = 225 - 60 * std::max(elevation, 0.0) + 5 * clouds.at<float>(y, x % 1024);
      const double hills = 135 - 250 * elevation + 10 * wood.at<float>(y, x % 1024);
      const double blend = std::clamp((skyline - elevation) / (2 * texel) + 0.5, 0.0, 1.0);
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(sky + blend * (hills - sky));
    }
  }
  builder.assets.scene.sky = &builder.addTexture(image, texel);
}

}  // namespace ground_scale_vo::simulation
