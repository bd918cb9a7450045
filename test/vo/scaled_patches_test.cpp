#include "vo/scaled_patches.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

using test::kCamera;
const cv::Size kSize(kCamera.width, kCamera.height);
const Eigen::Vector2d kPixel(200, 120);
const cv::Rect kRegion(150, 100, 90, 40);
constexpr int kHalf = ScaledPatches::kHalf_px, kPatchSide = 2 * kHalf + 1;

cv::Mat patchTexture(std::uint64_t seed) {
  cv::Mat image(kSize, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(image, image, {0, 0}, 1.5);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

TEST(ScaledPatches, CorrelationIsNormalised) {
  const cv::Mat from = patchTexture(1), to = patchTexture(2);
  ScaledPatches patches(kCamera, from, to, {}, kCamera.width);
  cv::Rect region = kRegion;
  const cv::Mat correlation = patches.correlate(kPixel, 0, &region);
  EXPECT_EQ(region, kRegion);
  cv::Mat patch, expected;
  cv::getRectSubPix(from, {kPatchSide, kPatchSide}, {200, 120}, patch);
  const cv::Rect pixels(region.tl() - cv::Point(kHalf, kHalf),
                        region.size() + cv::Size(2 * kHalf, 2 * kHalf));
  cv::matchTemplate(to(pixels), patch, expected, cv::TM_CCOEFF_NORMED);
  ASSERT_EQ(correlation.size(), expected.size());
  EXPECT_LT(cv::norm(correlation, expected, cv::NORM_INF), 1e-4);
}

TEST(ScaledPatches, CorrelationIsOneAtTheSamePatch) {
  const cv::Mat image = patchTexture(1), darker = image / 2;
  for (const cv::Mat& to : {image, darker}) {
    cv::Rect region = kRegion;
    const cv::Mat correlation =
        ScaledPatches(kCamera, image, to, {}, kCamera.width).correlate(kPixel, 0, &region);
    cv::Point peak;
    double value = 0;
    cv::minMaxLoc(correlation, nullptr, &value, nullptr, &peak);
    EXPECT_EQ(region.tl() + peak, cv::Point(200, 120));
    EXPECT_NEAR(value, 1, 1e-2);
  }
}

TEST(ScaledPatches, CorrelationWithAreasWithoutTextureIsZero) {
  const cv::Mat uniform(kSize, CV_8UC1, cv::Scalar(255));
  cv::Rect region = kRegion;
  const cv::Mat correlation = ScaledPatches(kCamera, patchTexture(1), uniform, {}, kCamera.width)
                                  .correlate(kPixel, 0, &region);
  ASSERT_EQ(correlation.size(), kRegion.size());
  EXPECT_LT(cv::norm(correlation, cv::NORM_INF), 1e-3);
}

TEST(ScaledPatches, PixelsAreThoseOfTheResizedImage) {
  const cv::Mat image = patchTexture(1);
  const ScaledPatches patches(kCamera, image, image, {}, kCamera.width / 2.0);
  // The centres of two pixels are that of the one they become.
  EXPECT_LT(cv::norm(patches.resized({10.5, 20.5}) - cv::Point2f(5, 10)), 1e-5);
  EXPECT_LT((patches.original({5, 10}) - Eigen::Vector2d(10.5, 20.5)).norm(), 1e-5);
}

TEST(ScaledPatches, AUniformPatchCorrelatesWithNothing) {
  const cv::Mat image = patchTexture(1);
  cv::Mat uniform(image.size(), CV_8UC1, cv::Scalar(90));
  uniform(cv::Rect(0, 0, 400, kCamera.height)).setTo(91);
  ScaledPatches patches(kCamera, uniform, image, {}, 400);
  cv::Rect region(50, 50, 9, 9);
  EXPECT_TRUE(patches.correlate({400, 124}, 0, &region).empty());
}

TEST(ScaledPatches, RegionIsReducedToWhereThePatchFits) {
  ScaledPatches patches(kCamera, patchTexture(1), patchTexture(2), {}, kCamera.width);
  cv::Rect region(-10, -10, 30, 30);
  EXPECT_EQ(patches.correlate(kPixel, 0, &region).size(), cv::Size(20 - kHalf, 20 - kHalf));
  EXPECT_EQ(region, cv::Rect(kHalf, kHalf, 20 - kHalf, 20 - kHalf));
  region = {kCamera.width - kHalf, 100, 10, 10};
  EXPECT_TRUE(patches.correlate(kPixel, 0, &region).empty());
}

TEST(ScaledPatches, MaskedPixelsHaveTheLeastCorrelation) {
  cv::Mat mask(kSize, CV_8UC1, cv::Scalar(255));
  mask.colRange(0, 180) = 0;
  ScaledPatches patches(kCamera, patchTexture(1), patchTexture(1), mask, kCamera.width);
  cv::Rect region = kRegion;
  const cv::Mat correlation = patches.correlate({300, 120}, 0, &region);
  const int first = 180 + kHalf - region.x;  // column of the first patch that is not masked
  EXPECT_EQ(cv::countNonZero(correlation.colRange(0, first) != -1), 0);
  EXPECT_EQ(cv::countNonZero(correlation.colRange(first, correlation.cols) == -1), 0);
  EXPECT_TRUE(patches.correlate(kPixel - Eigen::Vector2d(20, 0), 0, &region).empty());
}

TEST(ScaledPatches, AnyValueOfTheMaskButZeroIsScene) {
  const cv::Mat image = patchTexture(1), scene(kSize, CV_8UC1, cv::Scalar(1));
  const ScaledPatches patches(kCamera, image, image, scene, kCamera.width / 2.0);
  EXPECT_FALSE(patches.isMasked({200, 60}));
}

}  // namespace
}  // namespace ground_scale_vo
