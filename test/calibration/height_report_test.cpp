#include "ground_scale_vo/calibration/height_report.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <regex>
#include <sstream>

#include "ground_scale_vo/scale/mounting.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kReportedPitch = 0.1, kReportedRoll = 0.05;  // [rad]

HeightCalibration::Result calibrated() {
  HeightCalibration::Result result;
  result.status = HeightCalibration::Status::kOk;
  result.height = {1.2344, 0.01, 2.5};
  result.pitch = {kReportedPitch, 0.002, 2.5};
  result.roll = {kReportedRoll, 0.004, 2.5};
  return result;
}

TEST(HeightYaml, HasHeightAndAnglesWithTheir95PercentIntervals) {
  const std::string text = heightYaml(calibrated(), "From a test.");
  for (const char* line :
       {"# From a test.\n", "\ncamera_height: 1.2344  # [m] ± 0.0250 (95 %), 2.03 %\n",
        "\n# pitch: 5.73 deg ± 0.29 (95 %), positive looks down\n",
        "\n# roll: 2.86 deg ± 0.57 (95 %), positive: the right of the camera is lower\n"}) {
    EXPECT_NE(text.find(line), std::string::npos) << line << " in\n" << text;
  }
  HeightCalibration::Result unknown_mounting = calibrated();
  unknown_mounting.pitch = unknown_mounting.roll = {};
  EXPECT_EQ(heightYaml(unknown_mounting, "").find("static_transform_publisher"), std::string::npos);
}

TEST(HeightYaml, TransformStandsOnTheRoadAndFacesAsTheCamera) {
  const std::string text = heightYaml(calibrated(), "");
  std::smatch match;
  ASSERT_TRUE(std::regex_search(
      text, match, std::regex("\n# rosrun tf2_ros static_transform_publisher ([^b]*) base_link")))
      << text;
  std::istringstream numbers(match[1]);
  double x, y, z, qx, qy, qz, qw;
  ASSERT_TRUE(numbers >> x >> y >> z >> qx >> qy >> qz >> qw);
  EXPECT_EQ(x, 0);
  EXPECT_EQ(y, 0);
  EXPECT_EQ(z, 1.234);
  const Eigen::Quaterniond q_b_c(qw, qx, qy, qz);
  EXPECT_NEAR(q_b_c.norm(), 1, 1e-4);
  EXPECT_LT((q_b_c * roadNormal(kReportedPitch, kReportedRoll) - Eigen::Vector3d::UnitZ()).norm(),
            1e-4);
  // The optical axis points ahead and down, the camera's x axis to the right and down.
  const Eigen::Vector3d ahead = q_b_c * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d right = q_b_c * Eigen::Vector3d::UnitX();
  EXPECT_GT(ahead.x(), 0.99);
  EXPECT_NEAR(ahead.y(), 0, 1e-4);
  EXPECT_NEAR(ahead.z(), -std::cos(kReportedRoll) * std::sin(kReportedPitch), 1e-4);
  EXPECT_LT(right.y(), -0.99);
  EXPECT_NEAR(right.z(), -std::sin(kReportedRoll), 1e-4);
}

}  // namespace
}  // namespace ground_scale_vo
