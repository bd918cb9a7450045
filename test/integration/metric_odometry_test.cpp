#include "ground_scale_vo/metric_odometry.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {
namespace {

using Status = MetricOdometry::Status;

TEST(MetricOdometry, StatusIsTrackingIfAndOnlyIfThereIsAPose) {
  SyntheticDrive::Options drive_options;
  drive_options.frames = 30;
  const SyntheticDrive drive(drive_options);
  MetricOdometry::Options options;
  options.scale.camera_height = drive_options.camera_height;
  MetricOdometry odometry(drive.camera(), options);
  MetricOdometry::Output output;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    output = odometry.process(drive.image(i), drive.frame(i).stamp_ns);
    EXPECT_EQ(output.pose().has_value(), output.status() == Status::kTracking) << i;
    if (i == 0) {
      EXPECT_EQ(output.status(), Status::kInitialising);
    }
  }
  ASSERT_TRUE(output.pose());
  const double true_distance = drive.frame(drive.size() - 1).T_c0_c.translation().norm();
  EXPECT_NEAR(output.pose()->T_o_c.translation().norm(), true_distance, 0.15 * true_distance);
  EXPECT_GT(output.pose()->covariance.diagonal().minCoeff(), 0);
  EXPECT_STREQ(toString(output.status()), "tracking");
}

TEST(MetricOdometry, RequiresTheCameraHeight) {
  EXPECT_THROW(MetricOdometry({640, 480, 500, 500, 320, 240}, {}), OptionError);
}

}  // namespace
}  // namespace ground_scale_vo
