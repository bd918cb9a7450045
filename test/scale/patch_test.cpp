#include "scale/direct/patch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
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

// For the frames after a turn by 0.1 rad or a change of pitch by 0.03 rad.
TEST(PatchExtractor, StoresMarginsAroundThePatches) {
  const PinholeCamera camera{640, 480, 500, 520, 320, 200};
  cv::Mat noise(camera.height, camera.width, CV_8UC1);
  cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 256);
  RoadImage current;
  std::vector<Patch> patches;
  const PatchGrid grid(camera, 0.03);
  PatchExtractor(camera, 1, grid, 1, {})
      .extract(noise, LaneRegion({}, {}, 0, 3, 6, 0.5), false, &current, &patches);
  ASSERT_FALSE(patches.empty());
  cv::Rect region;
  for (const Patch& patch : patches) {
    region |= cv::Rect(patch.corner, cv::Size(grid.patch_px, grid.patch_px));
  }
  EXPECT_LE(current.roi.x, region.x - 0.1 * camera.fx);
  EXPECT_GE(current.roi.br().x, region.br().x + 0.1 * camera.fx);
  EXPECT_LE(current.roi.y, region.y - 0.03 * camera.fy);
}

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

TEST(PatchExtractor, AllowsNoPixelThatDependsOnTheMask) {
  const PinholeCamera camera{160, 120, 600, 600, 80, 30};  // smoothed with a radius of 2 px
  for (const int reduction : {1, 3}) {
    cv::Mat mask(reduction * camera.height, reduction * camera.width, CV_8UC1, cv::Scalar(255));
    mask.at<unsigned char>(reduction * 60, reduction * 80) = 0;
    const cv::Mat allowed =
        PatchExtractor(camera, reduction, PatchGrid(camera, 0.03), 1, mask).allowed();
    ASSERT_EQ(allowed.size(), cv::Size(camera.width, camera.height));
    // Smoothed twice, and the next pixel for the gradient.
    EXPECT_EQ(cv::countNonZero(allowed(cv::Rect(75, 55, 11, 11))), 0) << reduction;
    EXPECT_LT(cv::countNonZero(allowed == 0), 15 * 15) << reduction;
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
}

TEST(Patch, TheCorrelationOfUniformPatchesIsZero) {
  constexpr float kNoise = 1;
  Patch patch;
  patch.value.setConstant(100);
  Samples values = Samples::Constant(90);
  normalise(kNoise, &patch.value, &patch.texture);
  EXPECT_EQ(patch.texture, 0);
  EXPECT_EQ(correlate(patch, kNoise, &values), 0);
}

TEST(Patch, LargeImagesAreReducedByAWholeFactor) {
  const auto reduction = [](double fx) { return imageReduction({3100, 940, fx, fx, 1550, 460}); };
  EXPECT_EQ(reduction(1160), 1);
  EXPECT_EQ(reduction(1795), 2);
  EXPECT_EQ(reduction(1900), 3);
}

}  // namespace
}  // namespace ground_scale_vo::direct
