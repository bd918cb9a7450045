#include <gtest/gtest.h>

#include <cmath>

#include "simulation/synthetic_drive.hpp"

namespace gsv {
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

/// Mean absolute difference of one row [grey levels].
double rowDifference(const cv::Mat& a, const cv::Mat& b, int row) {
  return cv::norm(a.row(row), b.row(row), cv::NORM_L1) / a.cols;
}

TEST(RollingShutter, ExposesEachRowAtItsOwnTime) {
  Options options = driveAt20MetresPerSecond();
  options.readout_time = kReadoutTime;
  const SyntheticDrive rolling(options);
  options.readout_time = 0;
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

}  // namespace
}  // namespace gsv
