// A vehicle that publishes its speed: the camera height is learned and saved; speeds that cannot be
// used.

#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <std_msgs/Float64.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "common/time.hpp"
#include "manager_test.hpp"

namespace gsv {
namespace {

constexpr double kHeightTolerance = 0.03;  // relative

class Speed : public DriveTest<80> {
 protected:
  double height() const { return drive_->drive().cameraHeight(); }

  /// Of the camera at the frame, which is that of a vehicle that drives forward [m/s].
  static double speed(std::size_t i) {
    const std::size_t a = i == 0 ? 0 : i - 1, b = i == 0 ? 1 : i;
    return (drive_->frame(b).T_c0_c.translation() - drive_->frame(a).T_c0_c.translation()).norm() /
           secondsBetween(drive_->frame(a).stamp_ns, drive_->frame(b).stamp_ns);
  }

  /// Plays the drive with a speed, times the factor, before each image. The speed at an image is
  /// that between its neighbours.
  void play(NodeletPair& pair, const std::string& ns, double factor = 1) {
    using Message = geometry_msgs::TwistWithCovarianceStamped;
    const ros::Publisher speeds = handle_.advertise<Message>(ns + "/speed", 100);
    ASSERT_TRUE(waitUntil([&] { return speeds.getNumSubscribers() > 0; }));
    for (std::size_t i = 0; i < kFrames; ++i) {
      Message message;
      message.header.stamp = pair.stamp(i);
      message.twist.twist.linear.x =
          factor * 0.5 * (speed(i) + speed(std::min(i + 1, kFrames - 1)));
      message.twist.covariance[0] = std::pow(factor * 0.02, 2);
      speeds.publish(message);
      ASSERT_TRUE(pair.publishAndWait(i)) << i;
    }
  }
};

TEST_F(Speed, OfATwistWithCovarianceTeachesTheHeightWhichIsSaved) {
  const std::string file =
      std::filesystem::temp_directory_path() / ("speed_rostest_" + std::to_string(getpid()));
  NodeletPair pair(manager_, *drive_, "/saved");
  pair.setParam("scale_recovery", "camera_height", 1.05 * height());
  pair.setParam("scale_recovery", "camera_height_sigma", 0.1);
  pair.setParam("scale_recovery", "use_speed", true);
  pair.setParam("scale_recovery", "height_file", file);
  ASSERT_TRUE(pair.load());
  EXPECT_FALSE(callTrigger("/saved/scale_recovery/save_height"));
  EXPECT_FALSE(std::filesystem::exists(file));
  const ros::Publisher speeds =
      handle_.advertise<geometry_msgs::TwistWithCovarianceStamped>("/saved/speed", 1);
  ASSERT_TRUE(waitUntil([&] { return speeds.getNumSubscribers() > 0; }));
  speeds.publish(geometry_msgs::TwistWithCovarianceStamped());  // without a stamp
  EXPECT_TRUE(waitForLine("speed on /saved/speed has a stamp of zero"));
  play(pair, "/saved");
  pair.expectTrueLength(0.01);
  EXPECT_NEAR(pair.scales.last()->camera_height, height(), kHeightTolerance * height());
  const auto has_learned = [&](const Status& status) {
    return status.level != Status::ERROR && valueIn(status, "source") == "both" &&
           numberIn(status, "speeds received") == kFrames + 1 &&
           std::abs(numberIn(status, "camera height [m]") - height()) < kHeightTolerance * height();
  };
  EXPECT_TRUE(diagnostics_.waitForStatus("saved/scale_recovery", has_learned, false));
  EXPECT_TRUE(callTrigger("/saved/scale_recovery/save_height"));
  std::stringstream text;
  text << std::ifstream(file).rdbuf();
  EXPECT_NE(text.str().find("\ncamera_height: 1.6"), std::string::npos) << text.str();
  std::filesystem::remove(file);
}

// The height alone: as without the parameter.
TEST_F(Speed, ThatIsMissingOrOfAnotherTypeIsReportedAndTheRoadIsMeasured) {
  NodeletPair pair(manager_, *drive_, "/mute");
  pair.setParam("scale_recovery", "use_speed", true);
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.playUntilPose(0, kFrames / 2));
  EXPECT_TRUE(diagnostics_.waitForSummary("mute/scale_recovery", Status::WARN,
                                          "no speed received yet on /mute/speed"));
  EXPECT_TRUE(waitForLine("no speed received yet on /mute/speed"));
  EXPECT_EQ(lines("no speed received yet on /mute/speed"), 1);
  EXPECT_EQ(pair.scales.last()->source, ScaleEstimateMsg::SOURCE_ROAD);
  EXPECT_EQ(pair.scales.last()->camera_height, height());

  const ros::Publisher numbers = handle_.advertise<std_msgs::Float64>("/mute/speed", 10);
  ASSERT_TRUE(waitUntil([&] { return numbers.getNumSubscribers() > 0; }));
  numbers.publish(std_msgs::Float64());
  const std::string error = "speed on /mute/speed has the type std_msgs/Float64, whose unit is not";
  EXPECT_TRUE(diagnostics_.waitForSummary("mute/scale_recovery", Status::ERROR, error));
  EXPECT_TRUE(waitForLine(error));
  ASSERT_TRUE(pair.play(kFrames / 2 + 1, kFrames - 1));
  pair.expectTrueLength();
}

// The metres are those of the height; without one there are none.
TEST_F(Speed, InAnotherUnitIsAnErrorThatNamesIt) {
  NodeletPair given(manager_, *drive_, "/given");
  given.setParam("scale_recovery", "use_speed", true);
  ASSERT_TRUE(given.load());
  play(given, "/given", 3.6);
  given.expectTrueLength();
  EXPECT_TRUE(diagnostics_.waitForSummary("given/scale_recovery", Status::ERROR,
                                          "it looks like km/h taken as m/s"));

  NodeletPair unknown(manager_, *drive_, "/unknown");
  ros::param::del("/unknown/scale_recovery/camera_height");
  unknown.setParam("scale_recovery", "use_speed", true);
  ASSERT_TRUE(unknown.load());
  play(unknown, "/unknown", 3.6);
  EXPECT_TRUE(diagnostics_.waitForSummary("unknown/scale_recovery", Status::ERROR,
                                          "by the speeds, outside 0.2 to 4 m"));
  EXPECT_EQ(unknown.scales.last()->status, ScaleEstimateMsg::UNKNOWN);
}

TEST_F(Speed, OfTheNodeletsOwnOdometryIsRefused) {
  NodeletPair pair(manager_, *drive_, "/own");
  pair.remapped = {{"/own/speed", "/own/odometry"}};
  pair.setParam("scale_recovery", "use_speed", true);
  ASSERT_TRUE(pair.load());
  ASSERT_TRUE(pair.play(0, kFrames / 2));
  EXPECT_TRUE(diagnostics_.waitForSummary("own/scale_recovery", Status::ERROR,
                                          "speed is the nodelets' own output /own/odometry"));
  EXPECT_EQ(pair.scales.last()->source, ScaleEstimateMsg::SOURCE_ROAD);
}

}  // namespace
}  // namespace gsv
