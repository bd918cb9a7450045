#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "diagnosed.hpp"
#include "nodelet_pair.hpp"

namespace ground_scale_vo {

constexpr double kTolerance = 0.05;  // of the metric way

/// A manager, into which tests load their pairs and out of which they take them again, and a small
/// drive of so many frames.
template <std::size_t kFrames>
class DriveTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    drive_ = std::make_unique<RenderedDrive>(smallDrive(static_cast<int>(kFrames)));
  }
  static void TearDownTestSuite() { drive_.reset(); }
  void SetUp() override { ASSERT_TRUE(manager_.waitForIt()); }
  void TearDown() override { EXPECT_EQ(manager_.loaded(), 0u); }

  ManagerClient manager_{"/manager"};
  ros::NodeHandle handle_;
  Inbox<diagnostic_msgs::DiagnosticArray> diagnostics_{handle_, "/diagnostics"};
  static inline std::unique_ptr<RenderedDrive> drive_;
};

}  // namespace ground_scale_vo
