#include <gtest/gtest.h>

#include <cmath>

#include "simulation/synthetic_drive.hpp"

namespace ground_scale_vo {
namespace {

using Options = SyntheticDrive::Options;

constexpr double kReadoutTime = 0.03;

Options driveAt20MetresPerSecond() {
  Options options;
  options.frames = 3;
  options.speed = 20;
  options.suspension = 2;
  options.stop_s = options.noise_sigma = 0;
  return options;
}

SyntheticDrive rollingDrive() {
  Options options = driveAt20MetresPerSecond();
  options.readout_time = kReadoutTime;
  return SyntheticDrive(options);
}

/// Mean absolute difference of one row [grey levels].
double rowDifference(const cv::Mat& a, const cv::Mat& b, int row) {
  return cv::norm(a.row(row), b.row(row), cv::NORM_L1) / a.cols;
}

TEST(RollingShutter, ExposesEachRowAtItsOwnTime) {
  const SyntheticDrive rolling = rollingDrive();
  Options options = driveAt20MetresPerSecond();
  options.frame_rate_hz = 1000;
  options.frames = 201;  // the same road: its texture depends on its length
  const SyntheticDrive every_ms(options);
  constexpr std::size_t kStamp = 100;  // of the second image [ms]
  const cv::Mat image = rolling.image(1), at_stamp = every_ms.image(kStamp);
  const int height = rolling.camera().height;
  for (const int delay_ms : {-12, -6, 0, 6, 12}) {
    const int row = static_cast<int>(height * (0.5 + 1e-3 * delay_ms / kReadoutTime));
    const cv::Mat exposed = every_ms.image(kStamp + static_cast<std::size_t>(delay_ms));
    const double difference = rowDifference(image, exposed, row);
    EXPECT_LT(difference, 1) << delay_ms;
    if (delay_ms != 0) {
      EXPECT_GT(rowDifference(image, at_stamp, row), 3 * difference) << delay_ms;
    }
  }
}

TEST(RollingShutter, PosesAreThoseAtTheStamp) {
  const SyntheticDrive rolling = rollingDrive(), global(driveAt20MetresPerSecond());
  EXPECT_EQ(rolling.frame(1).stamp_ns, global.frame(1).stamp_ns);
  EXPECT_TRUE(rolling.frame(1).T_c0_c.isApprox(global.frame(1).T_c0_c, 0));
  EXPECT_EQ(rolling.frame(1).height, global.frame(1).height);
}

}  // namespace
}  // namespace ground_scale_vo
