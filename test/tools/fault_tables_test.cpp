#include "tools/support/fault_tables.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace ground_scale_vo {
namespace {

/// No threshold is violated. Each number differs from the others.
FaultDriveMetrics metrics() {
  FaultDriveMetrics m;
  m.frames = 200;
  m.tracked_frames = 190;
  FaultMetrics black, rain;
  black.name = "black";
  black.hides_ground = true;
  black.duration_s = 4.1;
  black.detection_delay_s = 0.2;
  black.tracking_recovery_frames = 3;
  black.metric_recovery_frames = 5;
  black.excess_path_m = 0.25;
  black.position_error_m = 0.6;
  black.sigma_m = 7;
  rain.name = "rain";
  rain.duration_s = 12;
  rain.detection_delay_s = std::numeric_limits<double>::quiet_NaN();
  rain.ok_frames = 90;
  rain.tracking_recovery_frames = -1;
  m.faults = {black, rain};
  m.segments = {{10, 39, 30.25, 1.5}, {81, 99, 8.5, 0.75}};
  return m;
}

TEST(FaultDriveText, HasALineForEachSegmentAndFault) {
  FaultDrive drive;
  drive.name = "drive 1";
  drive.options.frame_rate_hz = 11;
  drive.options.camera.width = 640;
  drive.options.camera.height = 480;
  drive.options.camera_height = 1.25;
  drive.options.speed = 6.5;
  drive.faults.resize(2);
  drive.faults[0].first = 40;
  drive.faults[0].last = 80;
  drive.faults[1].first = 100;
  drive.faults[1].last = 199;
  FaultDriveMetrics m = metrics();
  const std::string heading =
      "drive 1: 200 frames at 11 Hz, 640x480, camera 1.25 m high, 6.5 m/s; 190 tracked, ";
  const std::string segments =
      "  frames  10 to  39:  30.2 m, error 1.50 %\n"
      "  frames  81 to  99:   8.5 m, error 0.75 %\n";
  const std::string faults =
      "  frames  40 to  80: black          4.1 s, hides: detected 0.2 s, ok 0, tracking 3, metric "
      "5, "
      "excess path 0.25 m, error 0.6 m, sigma 7.0 m\n"
      "  frames 100 to 199: rain          12.0 s: detected nan s, ok 90, tracking -1, metric 0, "
      "excess path 0.00 m, error 0.0 m, sigma 0.0 m\n";
  EXPECT_EQ(faultDriveText(drive, m), heading + "0 not finite\n" + segments + faults);
  m.non_finite_frames = 2;
  EXPECT_EQ(faultDriveText(drive, m),
            heading + "2 not finite\n" + segments + faults +
                "  VIOLATED: 2 frames contain a number that is not finite\n");
}

TEST(FaultSummary, FailsWithOneDriveThatViolatesAThreshold) {
  FaultDriveMetrics violated = metrics();
  violated.segments.clear();
  const FaultSummary all_met = summarise({metrics(), metrics()});
  EXPECT_EQ(all_met.text, "2 drives, 0 with a violated threshold\n");
  EXPECT_EQ(all_met.exit_status, 0);
  const FaultSummary one = summarise({metrics(), violated, metrics()});
  EXPECT_EQ(one.text, "3 drives, 1 with a violated threshold\n");
  EXPECT_EQ(one.exit_status, 1);
}

TEST(SelectFaultDrives, HaveTheGivenFaultsAndSeed) {
  const auto drives = selectFaultDrives({"darker", "black"}, 7);
  ASSERT_EQ(drives.size(), 2u);
  EXPECT_EQ(drives[1].faults.at(0).name, faultDrive("black", 7).faults.at(0).name);
  EXPECT_EQ(drives[0].options.speed, faultDrive("darker", 7).options.speed);
  EXPECT_NE(drives[0].options.speed, faultDrive("darker", 8).options.speed);
  const auto all = selectFaultDrives({}, 7);
  ASSERT_EQ(all.size(), kFaultDriveCount);
  EXPECT_EQ(all[3].options.speed, faultDrive(3, 7).options.speed);
  EXPECT_NE(all[3].options.speed, faultDrive(3, 8).options.speed);
}

}  // namespace
}  // namespace ground_scale_vo
