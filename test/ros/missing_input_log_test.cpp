#include "ground_scale_vo/ros/missing_input_log.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ground_scale_vo {
namespace {

class MissingInputLogging : public testing::Test {
 protected:
  std::string due(double at_s, const std::optional<MissingInput>& missing, bool clock_runs = true) {
    return log_.due(missing, clock_runs,
                    MissingInputLog::Clock::time_point(std::chrono::seconds(1000)) +
                        std::chrono::milliseconds(static_cast<int>(1000 * at_s)));
  }

  const MissingInput no_image_{"image", "no image", false}, no_info_{"info", "no info", false};
  const MissingInput silent_{"image", "no image", true};
  MissingInputLog log_;
};

TEST_F(MissingInputLogging, AnInputThatWasNeverReceivedIsDueAfter5SecondsAndEvery30) {
  EXPECT_EQ(due(0, no_image_), "");
  EXPECT_EQ(due(4.9, no_image_), "");
  EXPECT_EQ(due(5, no_image_, false), "no image");  // also without a clock
  EXPECT_EQ(due(34.9, no_image_), "");
  EXPECT_EQ(due(35, no_image_), "no image");
  EXPECT_EQ(due(36, no_info_), "") << "the next input has 5 seconds of its own";
  EXPECT_EQ(due(40.9, no_info_), "");
  EXPECT_EQ(due(41, no_info_), "no info");
  EXPECT_EQ(due(42, std::nullopt), "");
}

TEST_F(MissingInputLogging, AnInputThatEndsIsDueAtOnceWhileTheClockRuns) {
  EXPECT_EQ(due(0, silent_), "no image");
  EXPECT_EQ(due(1, std::nullopt), "");
  EXPECT_EQ(due(29, silent_), "");
  EXPECT_EQ(due(100, silent_, false), "") << "a bag that is paused or has ended";
  EXPECT_EQ(due(101, silent_), "no image");
}

TEST_F(MissingInputLogging, AClockRunsIfItHasAdvancedSinceTheLastCall) {
  EXPECT_EQ(log_.due(std::nullopt, ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent_, ros::Time(5)), "");
  EXPECT_EQ(log_.due(silent_, ros::Time(6)), "no image");
}

}  // namespace
}  // namespace ground_scale_vo
