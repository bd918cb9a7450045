#include "ground_scale_vo/ros/missing_input_log.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ground_scale_vo {
namespace {

using std::chrono::seconds;

class MissingInputLogTest : public testing::Test {
 protected:
  std::string due(double at_s, const std::optional<MissingInput>& missing, bool clock_runs = true) {
    return log_.due(missing, clock_runs,
                    MissingInputLog::Clock::time_point(seconds(1000)) +
                        std::chrono::milliseconds(static_cast<int>(1000 * at_s)));
  }
  static MissingInput never(const std::string& input) { return {input, "no " + input, false}; }
  static MissingInput silent(const std::string& input) { return {input, "no " + input, true}; }

  MissingInputLog log_;
};

TEST_F(MissingInputLogTest, AnInputThatWasNeverReceivedIsDueAfter5SecondsAndEvery30) {
  EXPECT_EQ(due(0, never("image")), "");
  EXPECT_EQ(due(4.9, never("image")), "");
  EXPECT_EQ(due(5, never("image"), false), "no image");  // also without a clock
  EXPECT_EQ(due(34.9, never("image")), "");
  EXPECT_EQ(due(35, never("image")), "no image");
}

TEST_F(MissingInputLogTest, TheNextInputHas5SecondsOfItsOwn) {
  EXPECT_EQ(due(0, never("image")), "");
  EXPECT_EQ(due(5, never("image")), "no image");
  EXPECT_EQ(due(6, never("camera_info")), "");
  EXPECT_EQ(due(10.9, never("camera_info")), "");
  EXPECT_EQ(due(11, never("camera_info")), "no camera_info");
  EXPECT_EQ(due(12, std::nullopt), "");
}

TEST_F(MissingInputLogTest, AnInputThatEndsIsDueAtOnceButNotMoreOften) {
  EXPECT_EQ(due(0, silent("image")), "no image");
  EXPECT_EQ(due(1, std::nullopt), "");
  EXPECT_EQ(due(29, silent("image")), "");
  EXPECT_EQ(due(30, silent("image")), "no image");
}

TEST_F(MissingInputLogTest, ABagThatIsPausedOrHasEndedIsNotReported) {
  EXPECT_EQ(due(0, silent("image"), false), "");
  EXPECT_EQ(due(100, silent("image"), false), "");
  EXPECT_EQ(due(101, silent("image")), "no image");
}

TEST_F(MissingInputLogTest, AClockRunsIfItHasAdvancedSinceTheLastCall) {
  EXPECT_EQ(log_.due(std::nullopt, ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent("image"), ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent("image"), ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent("image"), ros::Time(6)), "no image");
}

}  // namespace
}  // namespace ground_scale_vo
