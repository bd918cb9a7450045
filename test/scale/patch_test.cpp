#include "scale/direct/patch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace ground_scale_vo::direct {
namespace {

TEST(PatchExtractor, APartOfALargeImageIsReducedLikeTheWholeImage) {
  const PinholeCamera camera{320, 240, 600, 600, 160, 60};
  cv::Mat large(2 * camera.height + 1, 2 * camera.width + 1, CV_8UC1), small;
  cv::RNG(1).fill(large, cv::RNG::UNIFORM, 0, 256);
  const cv::Rect whole_pixels(0, 0, 2 * camera.width, 2 * camera.height);
  cv::resize(large(whole_pixels), small, {camera.width, camera.height}, 0, 0, cv::INTER_AREA);
  const auto extracted = [&](const cv::Mat& image, int reduction) {
    std::pair<RoadImage, std::vector<Patch>> result;
    PatchExtractor(camera, reduction, PatchGrid(camera, 0.03), 1, {})
        .extract(image, LaneRegion({}, {}, 0, 3, 20, 0.3), false, &result.first, &result.second);
    return result;
  };
  const auto [image, patches] = extracted(large, 2);
  const auto [expected_image, expected_patches] = extracted(small, 1);
  ASSERT_GT(patches.size(), 5u);
  ASSERT_EQ(patches.size(), expected_patches.size());
  EXPECT_EQ(image.roi, expected_image.roi);
  EXPECT_GT(image.roi.x, 5);  // Inside the image on three sides.
  EXPECT_GT(image.roi.y, 5);
  EXPECT_LT(image.roi.br().x, camera.width - 5);
  EXPECT_LT(cv::norm(image.storage, expected_image.storage, cv::NORM_INF), 1e-3);
  for (std::size_t i = 0; i < patches.size(); ++i) {
    EXPECT_LT((patches[i].value - expected_patches[i].value).abs().maxCoeff(), 1e-3f);
  }
}

TEST(Patch, AReducedPixelIsTheCentreOfItsPixels) {
  const PinholeCamera camera{640, 480, 500, 510, 321, 239};
  const PinholeCamera small = reduced(camera, 3);
  EXPECT_EQ(small.width, 213);
  EXPECT_EQ(small.height, 160);
  EXPECT_LT((small.ray({0, 0}) - camera.ray({1, 1})).norm(), 1e-12);
  EXPECT_LT((small.ray({100, 50}) - camera.ray({301, 151})).norm(), 1e-12);
}

TEST(Patch, NoiseDoesNotLowerTheCorrelation) {
  constexpr float kNoise = 10;
  Patch patch;
  for (int i = 0; i < kPatchSamples; ++i) {
    patch.value[i] = 100 + 12 * std::sin(0.7f * static_cast<float>(i));
  }
  Samples same = patch.value, brighter = 1.5f * patch.value + 20, inverted = -patch.value;
  normalise(kNoise, &patch.value, &patch.texture);
  EXPECT_LT(patch.texture, 0.5f);
  EXPECT_NEAR(correlate(patch, kNoise, &same), 1, 1e-3);
  EXPECT_NEAR(correlate(patch, kNoise, &brighter), 1, 1e-3);
  EXPECT_NEAR(correlate(patch, kNoise, &inverted), -1, 1e-3);
  Samples uniform = Samples::Constant(90);
  EXPECT_EQ(correlate(patch, kNoise, &uniform), 0);
}

}  // namespace
}  // namespace ground_scale_vo::direct
