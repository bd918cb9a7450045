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

TEST(ImageFaults, ChangeTheImageButNotTheirInput) {
  const cv::Mat image = randomImage(1);
  for (const FaultKind kind :
       {FaultKind::kBlack, FaultKind::kWhite, FaultKind::kCovered, FaultKind::kDarker,
        FaultKind::kBrighter, FaultKind::kFlicker, FaultKind::kCoveredBelow,
        FaultKind::kCoveredLeft, FaultKind::kRain}) {
    const cv::Mat result = withFault(kind, image, 0, 7);
    EXPECT_GT(cv::norm(result, image, cv::NORM_L1) / static_cast<double>(image.total()), 3)
        << static_cast<int>(kind);  // [grey levels]
    EXPECT_TRUE(same(image, randomImage(1))) << static_cast<int>(kind);
  }
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
