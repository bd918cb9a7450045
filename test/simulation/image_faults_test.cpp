#include "simulation/image_faults.hpp"

#include <gtest/gtest.h>

#include "simulation/synthetic_drive.hpp"

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
  const cv::Mat image = randomImage(1);
  const auto mean = [](const cv::Mat& m) { return cv::mean(m)[0]; };
  const auto contrast = [](const cv::Mat& m) {
    cv::Scalar average, deviation;
    cv::meanStdDev(m, average, deviation);
    return deviation[0];
  };
  const auto faulty = [&](FaultKind kind, std::size_t k = 0) {
    const cv::Mat result = withFault(kind, image, k, 7);
    EXPECT_EQ(result.size(), image.size()) << static_cast<int>(kind);
    EXPECT_EQ(result.type(), CV_8UC1) << static_cast<int>(kind);
    EXPECT_TRUE(same(image, randomImage(1))) << static_cast<int>(kind) << " writes into its input";
    return result;
  };
  EXPECT_EQ(mean(faulty(FaultKind::kBlack)), 0);
  EXPECT_EQ(mean(faulty(FaultKind::kWhite)), 255);
  EXPECT_LT(mean(faulty(FaultKind::kCovered)), 0.2 * mean(image));
  EXPECT_LT(contrast(faulty(FaultKind::kCovered)), 3);
  EXPECT_NEAR(mean(faulty(FaultKind::kDarker)), 0.4 * mean(image), 1);
  EXPECT_GT(mean(faulty(FaultKind::kBrighter)), 2 * mean(image));
  EXPECT_GT(std::abs(mean(faulty(FaultKind::kFlicker, 0)) - mean(faulty(FaultKind::kFlicker, 1))),
            3);
  // Mud: the clean part shows the scene plus sensor noise.
  const cv::Rect top(0, 0, 200, 10), bottom(0, 40, 200, 20), left(0, 0, 90, 60),
      right(120, 0, 80, 60);
  const cv::Mat below = faulty(FaultKind::kCoveredBelow), aside = faulty(FaultKind::kCoveredLeft);
  EXPECT_LT(cv::norm(below(top), image(top), cv::NORM_INF), 8);
  EXPECT_LT(contrast(below(bottom)), 0.6 * contrast(image(bottom)));
  EXPECT_LT(cv::norm(aside(right), image(right), cv::NORM_INF), 8);
  EXPECT_LT(contrast(aside(left)), 0.6 * contrast(image(left)));
  // Rain changes from image to image and leaves most of the image visible.
  EXPECT_FALSE(same(faulty(FaultKind::kRain, 0), faulty(FaultKind::kRain, 1)));
  EXPECT_LT(cv::countNonZero(faulty(FaultKind::kRain) != image), 0.6 * 60 * 200);
}

TEST(ImageFaults, ActInTheirFramesOfADrive) {
  SyntheticDrive::Options options;
  options.camera = {160, 50, 93, 93, 80, 25};
  options.frames = 8;
  const SyntheticDrive faultless(options);
  options.faults = {{FaultKind::kBlack, {2, 3}}, {FaultKind::kFrozen, {5, 6}}};
  const SyntheticDrive drive(options);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (i == 2 || i == 3) {
      EXPECT_EQ(cv::countNonZero(drive.image(i)), 0) << i;
    } else {
      EXPECT_TRUE(same(drive.image(i), faultless.image(i == 5 || i == 6 ? 4 : i))) << i;
    }
  }
}

}  // namespace
}  // namespace ground_scale_vo
