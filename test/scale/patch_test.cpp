#include "scale/direct/patch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

namespace ground_scale_vo::direct {
namespace {

TEST(PatchExtractor, AUniformImageHasNoGradientAlsoAtTheEdgeOfTheRegion) {
  // With so short a focal length the margin of the region is less than a pixel.
  const PinholeCamera camera{640, 480, 20, 20, 320, 240};
  const cv::Mat uniform(camera.height, camera.width, CV_8UC1, cv::Scalar(100));
  RoadImage current;
  current.storage.create(camera.height, camera.width, CV_32F);
  std::vector<Patch> patches;
  PatchExtractor(camera, 1, PatchGrid(camera, 0.03), 1, {})
      .extract(uniform, LaneRegion({}, {}, 0, 0.1, 20, 5), false, &current, &patches);
  ASSERT_FALSE(patches.empty());
  for (const Patch& patch : patches) {
    ASSERT_LT(patch.grad_x.abs().maxCoeff(), 1e-3) << patch.corner;
    ASSERT_LT(patch.grad_y.abs().maxCoeff(), 1e-3) << patch.corner;
  }
}

// With a camera that faces backwards, the reference images are the ones nearer to the road.
TEST(PatchExtractor, SmoothsTheImagesThatShowTheRoadFromNearerTwice) {
  const PinholeCamera camera{640, 480, 500, 500, 320, 240};
  cv::Mat noise(camera.height, camera.width, CV_8UC1);
  cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 256);
  const auto contrasts = [&](bool faces_backwards) {
    RoadImage current;
    current.storage.create(camera.height, camera.width, CV_32F);
    std::vector<Patch> patches;
    PatchExtractor(camera, 1, PatchGrid(camera, 0.03), 20, {})
        .extract(noise, LaneRegion({}, {}, 0, 0.1, 20, 5), faces_backwards, &current, &patches);
    double texture = 0;
    for (const Patch& patch : patches)
      texture += patch.texture / static_cast<double>(patches.size());
    cv::Scalar mean, deviation;
    cv::meanStdDev(current.storage(cv::Rect({0, 0}, current.roi.size())), mean, deviation);
    return std::pair(texture, deviation[0]);
  };
  const auto [patches_ahead, image_ahead] = contrasts(false);
  const auto [patches_behind, image_behind] = contrasts(true);
  EXPECT_LT(patches_ahead, 0.8 * patches_behind);
  EXPECT_GT(image_ahead, 1.2 * image_behind);
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
}

TEST(Patch, LargeImagesAreReducedByAWholeFactor) {
  const auto reduction = [](double fx) { return imageReduction({3100, 940, fx, fx, 1550, 460}); };
  EXPECT_EQ(reduction(1160), 1);
  EXPECT_EQ(reduction(1795), 2);
  EXPECT_EQ(reduction(1900), 3);
}

}  // namespace
}  // namespace ground_scale_vo::direct
