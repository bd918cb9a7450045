#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "nodelet_pair.hpp"
#include "wait_for_diagnostics.hpp"

namespace ground_scale_vo {

/// Allowed deviation of NodeletPair::displacementRatio() from 1.
constexpr double kTolerance = 0.05;

/// The nodelet manager of the .test file, into which tests load their nodelets, and a drive of
/// small images. No nodelet may be left after a test.
template <std::size_t frame_count>
class DriveTest : public testing::Test {
 protected:
  static constexpr std::size_t kFrames = frame_count;

  static void SetUpTestSuite() {
    drive_ = std::make_unique<RenderedDrive>(smallDrive(static_cast<int>(kFrames)));
  }
  static void TearDownTestSuite() { drive_.reset(); }
  void SetUp() override { ASSERT_TRUE(manager_.waitForServices()); }
  void TearDown() override { EXPECT_EQ(manager_.loaded(), 0u); }

  ManagerClient manager_{"/manager"};
  ros::NodeHandle handle_;
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics_{handle_, "/diagnostics"};
  static inline std::unique_ptr<RenderedDrive> drive_;
};

}  // namespace ground_scale_vo
