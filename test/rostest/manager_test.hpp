#pragma once

#include <rosgraph_msgs/Log.h>

#include "nodelet_pair.hpp"

namespace gsv {

/// The nodelet manager of the .test file, into which tests load their nodelets. No nodelet may be
/// left after a test.
class ManagerTest : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(manager_.waitForServices());
    // The manager may not have noticed yet that the connection of the test before is closed.
    ASSERT_TRUE(waitUntil([this] { return !isSent("/rosout", manager_.name()); }));
    log_.emplace(handle_, "/rosout");
    ASSERT_TRUE(waitUntil([this] { return log_->connected(manager_.name()); }));
  }
  void TearDown() override { EXPECT_EQ(manager_.loaded(), 0u); }

  /// Number of lines of the log that contain both texts.
  std::ptrdiff_t lines(const std::string& text, const std::string& other = "") {
    const auto all = log_->messages();
    return std::count_if(all.begin(), all.end(), [&](const auto& line) {
      return line->msg.find(text) != std::string::npos &&
             line->msg.find(other) != std::string::npos;
    });
  }
  bool waitForLine(const std::string& text, const std::string& other = "") {
    return waitUntil([&] { return lines(text, other) > 0; });
  }

  ManagerClient manager_{"/manager"};
  ros::NodeHandle handle_;
  DiagnosticsRecorder diagnostics_{handle_};
  std::optional<TopicRecorder<rosgraph_msgs::Log>> log_;
};

/// The same, and a drive of small images.
template <std::size_t frame_count, int frame_rate_hz = 10>
class DriveTest : public ManagerTest {
 protected:
  static constexpr std::size_t kFrames = frame_count;

  static void SetUpTestSuite() {
    SyntheticDrive::Options options = smallDrive(static_cast<int>(kFrames));
    options.frame_rate_hz = frame_rate_hz;
    options.stop_s = 0;
    drive_ = std::make_unique<RenderedDrive>(options);
  }
  static void TearDownTestSuite() { drive_.reset(); }

  static inline std::unique_ptr<RenderedDrive> drive_;
};

}  // namespace gsv
