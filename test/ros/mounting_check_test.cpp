#include "ground_scale_vo/ros/mounting_check.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "ground_scale_vo/scale/mounting.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kDegree = M_PI / 180;

/// The sentence for a transform on tf and an estimate with these angles [deg].
std::string check(double tf_pitch, double tf_roll, double pitch, double roll, double sigma) {
  ScaleRecovery::Output output;
  output.mounting_pitch = pitch * kDegree;
  output.mounting_roll = roll * kDegree;
  output.mounting_sigma = sigma * kDegree;
  return mountingContradiction("base_link", "camera",
                               roadNormal(tf_pitch * kDegree, tf_roll * kDegree), output);
}

TEST(MountingCheck, NamesBothPitchesAndRollsAndTheConsequence) {
  EXPECT_EQ(check(0, 0, 8, 0.02, 0.1),
            "tf mounts the camera \"camera\" on \"base_link\" with pitch 0.0 deg and roll 0.0 deg, "
            "but on the road it has pitch 8.0 deg and roll 0.0 deg: the path climbs or sinks by up "
            "to 8.0 deg");
  EXPECT_NE(check(-2, 5, 3, -6, 0.1)
                .find("with pitch -2.0 deg and roll 5.0 deg, but on the road it "
                      "has pitch 3.0 deg and roll -6.0 deg"),
            std::string::npos);
  ScaleRecovery::Output output;  // a base that is upside down or optical
  for (const Eigen::Vector3d& up_c : {Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, 0, 1)}) {
    EXPECT_NE(mountingContradiction("base_link", "camera", up_c, output), "") << up_c.transpose();
  }
}

TEST(MountingCheck, AcceptsAVehicleThatRidesTiltedAndAnUncertainEstimate) {
  for (const double tilt : {-2.0, 0.0, 2.0}) {
    for (const double pitch : {-3.0, 0.0, 20.0}) {
      EXPECT_EQ(check(pitch, 0, pitch + tilt, 0, 0.1), "");
      EXPECT_EQ(check(pitch, 10, pitch, 10 + tilt, 0.1), "");
    }
  }
  // As constructed: the pitch is zero, and not known.
  EXPECT_EQ(check(30, 15, 0, 0, Mounting({}).sigma() / kDegree), "");
  // The deviation may be due to the uncertainty.
  EXPECT_EQ(check(0, 0, 4, 0, 0.4), "");
  EXPECT_NE(check(0, 0, 4, 0, 0.1), "");
}

}  // namespace
}  // namespace ground_scale_vo
