#include "simulation/image_faults.hpp"

#include <gtest/gtest.h>

#include "simulation/synthetic_drive.hpp"

namespace gsv {
namespace {

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::countNonZero(a != b) == 0;
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
}  // namespace gsv
