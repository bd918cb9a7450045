#include "ground_scale_vo/simulation/image_faults.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

cv::Mat randomImage(std::uint64_t seed) {
  cv::Mat image(60, 200, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 40, 140);
  return image;
}

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::countNonZero(a != b) == 0;
}

TEST(ImageFaults, HaveTheirDocumentedEffect) {
  const cv::Mat image = randomImage(1), before = randomImage(2);
  const auto mean = [](const cv::Mat& m) { return cv::mean(m)[0]; };
  const auto contrast = [](const cv::Mat& m) {
    cv::Scalar average, deviation;
    cv::meanStdDev(m, average, deviation);
    return deviation[0];
  };
  const auto faulty = [&](ImageFault fault, std::size_t k = 0) {
    const cv::Mat result = injectFault(fault, needsScene(fault) ? image : cv::Mat(), before, k, 7);
    EXPECT_EQ(result.size(), image.size()) << toString(fault);
    EXPECT_EQ(result.type(), CV_8UC1) << toString(fault);
    EXPECT_TRUE(same(image, randomImage(1))) << toString(fault) << " writes into its input";
    return result;
  };
  EXPECT_EQ(mean(faulty(ImageFault::kBlack)), 0);
  EXPECT_EQ(mean(faulty(ImageFault::kWhite)), 255);
  EXPECT_TRUE(same(faulty(ImageFault::kFrozen, 0), before));
  EXPECT_TRUE(same(faulty(ImageFault::kFrozen, 9), before));
  EXPECT_LT(mean(faulty(ImageFault::kCovered)), 0.2 * mean(image));
  EXPECT_LT(contrast(faulty(ImageFault::kCovered)), 3);
  EXPECT_NEAR(mean(faulty(ImageFault::kDarker)), 0.4 * mean(image), 1);
  EXPECT_GT(mean(faulty(ImageFault::kBrighter)), 2 * mean(image));
  EXPECT_GT(std::abs(mean(faulty(ImageFault::kFlicker, 0)) - mean(faulty(ImageFault::kFlicker, 1))),
            3);
  // Mud: the clean part shows the scene plus sensor noise.
  const cv::Rect top(0, 0, 200, 10), bottom(0, 40, 200, 20), left(0, 0, 90, 60),
      right(120, 0, 80, 60);
  const cv::Mat below = faulty(ImageFault::kCoveredBelow), aside = faulty(ImageFault::kCoveredLeft);
  EXPECT_LT(cv::norm(below(top), image(top), cv::NORM_INF), 8);
  EXPECT_LT(contrast(below(bottom)), 0.6 * contrast(image(bottom)));
  EXPECT_LT(cv::norm(aside(right), image(right), cv::NORM_INF), 8);
  EXPECT_LT(contrast(aside(left)), 0.6 * contrast(image(left)));
  // Rain changes from image to image and leaves most of the image visible.
  EXPECT_FALSE(same(faulty(ImageFault::kRain, 0), faulty(ImageFault::kRain, 1)));
  EXPECT_LT(cv::countNonZero(faulty(ImageFault::kRain) != image), 0.6 * 60 * 200);
}

}  // namespace
}  // namespace ground_scale_vo
