#include "ground_scale_vo/metric_odometry.hpp"

#include <gtest/gtest.h>

#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/drive_run.hpp"

namespace ground_scale_vo {
namespace {

using Status = MetricOdometry::Status;

TEST(MetricOdometry, StatusIsTrackingIfAndOnlyIfThereIsAPose) {
  SyntheticDrive::Options drive_options;
  drive_options.frames = 30;
  const SyntheticDrive drive(drive_options);
  MetricOdometry odometry(drive.camera(), optionsFor(drive_options.camera_height));
  MetricOdometry::Output output;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    output = odometry.process(drive.image(i), drive.frame(i).stamp_ns);
    EXPECT_EQ(output.pose().has_value(), output.status() == Status::kTracking) << i;
  }
  ASSERT_TRUE(output.pose());
  const double true_distance = drive.frame(drive.size() - 1).T_c0_c.translation().norm();
  EXPECT_NEAR(output.pose()->T_o_c.translation().norm(), true_distance, 0.15 * true_distance);
  EXPECT_GT(output.pose()->covariance.diagonal().minCoeff(), 0);
}

TEST(MetricOdometry, StatusWithoutAPoseIsThatOfTheOdometry) {
  MetricOdometry::Output output;
  for (const auto& [vo, expected] :
       {std::pair(VoStatus::kInitialising, Status::kInitialising),
        std::pair(VoStatus::kTracking, Status::kInitialising),  // no scale yet
        std::pair(VoStatus::kLost, Status::kLost)}) {
    output.vo.frame.status = vo;
    EXPECT_EQ(output.status(), expected) << toString(vo);
  }
}

TEST(MetricOdometry, BothStagesGetImageAndMask) {
  SyntheticDrive::Options drive_options = smallImages();
  drive_options.frames = 20;
  const SyntheticDrive drive(drive_options);
  const MetricOdometry::Options options = optionsFor(drive_options.camera_height);
  // Covers a part of the road, which both stages use.
  cv::Mat mask(drive.camera().height, drive.camera().width, CV_8U, cv::Scalar(255));
  mask(cv::Rect(180, 125, 60, 25)).setTo(0);

  MetricOdometry odometry(drive.camera(), options, mask);
  VisualOdometry vo(drive.camera(), options.odometry.vo, mask);
  ScaleRecovery recovery(options.scale);
  int direct = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const cv::Mat image = drive.image(i);
    const MetricOdometry::Output output = odometry.process(image, drive.frame(i).stamp_ns);
    const VoFrame frame = vo.process(image, drive.frame(i).stamp_ns).frame;
    const ScaleRecovery::Output scale = recovery.process(frame, image, mask);
    ASSERT_EQ(output.vo.frame.features.size(), frame.features.size()) << i;
    ASSERT_EQ(output.vo.frame.T_w_c.matrix(), frame.T_w_c.matrix()) << i;
    ASSERT_EQ(output.scale.direct.height, scale.direct.height) << i;
    ASSERT_EQ(output.scale.scale.scale, scale.scale.scale) << i;
    direct += scale.direct.height > 0;
  }
  EXPECT_GT(direct, 2);
}

}  // namespace
}  // namespace ground_scale_vo
