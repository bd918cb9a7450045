// Overload, stalled subscribers, and unloading at any moment: the newest images are processed,
// dropped ones are counted, the scale stays correct, subscribers do not affect the results, and
// nothing of an unloaded nodelet is left.

#include "child_process.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/ros_tools/node_process.hpp"
#include "manager_test.hpp"

namespace gsv {
namespace {

// A camera that is three times too fast.
class Overload : public DriveTest<120, 30> {
 protected:
  /// Resident memory [MiB].
  double memoryOfManager() const { return processUsage(processOf(manager_.name()).value()).rss_mb; }
};

TEST_F(Overload, TheScaleStaysCorrectOverTheGaps) {
  NodeletPair pair(manager_, *drive_, "/gaps");
  pair.setParam("mono_vo", "queue_size", 1);
  ASSERT_TRUE(pair.load());
  // Bursts of three; the next one after the result of the newest image.
  for (std::size_t i = 0; i < kFrames; i += 3) {
    for (std::size_t k = i; k < i + 3; ++k) pair.publish(k);
    ASSERT_TRUE(pair.waitForResult(i + 2)) << i;
  }
  EXPECT_TRUE(diagnostics_.waitForSummary("gaps/mono_vo", Status::WARN,
                                          "images dropped in the last second", false));
  ASSERT_TRUE(pair.odometry.waitForStamp(pair.lastStamp()));
  EXPECT_LT(pair.frames.count(), kFrames);
  pair.expectTrueLength();
}

// One subscriber is stopped and never reads its sockets; others connect and disconnect.
TEST_F(Overload, SubscribersDoNotAffectTheResults) {
  constexpr std::size_t kPart = 10, kPlayed = 60;
  NodeletPair alone(manager_, *drive_, "/alone");
  ASSERT_TRUE(alone.load());
  ASSERT_TRUE(alone.playUntilPose(0, kPlayed - 1));
  EXPECT_TRUE(alone.unload());

  NodeletPair watched(manager_, *drive_, "/watched");
  ASSERT_TRUE(watched.load());
  ChildProcess stalled({"env", "PYTHONUNBUFFERED=1", "rostopic", "hz", "/watched/vo/frame",
                        "/watched/odometry", "/watched/vo/image_tracks"});
  const auto waitForOutput = [&](const std::string& text) {
    return waitUntil([&] { return stalled.output().find(text) != std::string::npos; });
  };
  for (const char* topic : {"/watched/vo/frame", "/watched/odometry", "/watched/vo/image_tracks"}) {
    ASSERT_TRUE(waitUntil([&] { return isSent(topic, "", "/rostopic_"); })) << topic;
  }
  ASSERT_TRUE(watched.play(0, kPart - 1));
  ASSERT_TRUE(waitForOutput("min_delta")) << stalled.output();  // it receives messages
  stalled.send(SIGSTOP);
  const double rss_mb = memoryOfManager();
  for (std::size_t i = kPart; i < kPlayed; i += kPart) {
    std::unique_ptr<Display> display;
    if (i % (2 * kPart) == 0) {
      display = std::make_unique<Display>(handle_, "/watched");
      ASSERT_TRUE(waitUntil([&] { return display->connected(); }));
    }
    ASSERT_TRUE(watched.play(i, i + kPart - 1));
    if (display) {
      EXPECT_TRUE(display->tracks.waitForCount(1));
    }
  }
  ASSERT_TRUE(watched.odometry.waitForStamp(watched.stamp(kPlayed - 1)));
  const auto before = alone.odometry.messages(), now = watched.odometry.messages();
  ASSERT_GT(before.size(), kPlayed / 2);
  ASSERT_EQ(now.size(), before.size());
  for (std::size_t i = 0; i < now.size(); ++i) {
    EXPECT_EQ(now[i]->pose.pose, before[i]->pose.pose) << i;
  }
  if (!kSanitized) {
    EXPECT_LT(memoryOfManager() - rss_mb, 60);  // [MiB]
  }
}

// Both nodelets, unloaded in either order while they process images.
TEST_F(Overload, UnloadingIsCleanWhileImagesArrive) {
  constexpr int kReloads = 50, kWarmUpReloads = 15;
  constexpr double kMaxGrowth = 4;  // of the memory after the warm-up [MiB]; measured: 0.04
  const std::string nodelets[] = {"/mono_vo", "/scale_recovery"};
  ros::param::set("/scale_recovery/camera_height", 1.65);
  TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
  double rss_mb = 0;
  {
    const RepeatingCamera camera(*drive_);
    for (int i = 0; i < kReloads; ++i) {
      if (i == kWarmUpReloads) {
        rss_mb = memoryOfManager();
      }
      ASSERT_TRUE(manager_.load("MonoVo", nodelets[0]));
      ASSERT_TRUE(manager_.load("ScaleRecovery", nodelets[1]));
      frames.clear();
      EXPECT_TRUE(frames.waitForCount(static_cast<std::size_t>(1 + i % 3))) << "load " << i;
      ASSERT_TRUE(manager_.unload(nodelets[i % 2]));
      ASSERT_TRUE(manager_.unload(nodelets[1 - i % 2]));
    }
  }
  ros::master::V_TopicInfo topics;
  ASSERT_TRUE(ros::master::getTopics(topics));
  for (const auto& topic : topics) {  // those that are published
    EXPECT_NE(topic.name, "/odometry");
    EXPECT_NE(topic.name, "/vo/frame");
  }
  if (!kSanitized) {
    EXPECT_LT(memoryOfManager() - rss_mb, kMaxGrowth) << "from " << rss_mb << " MiB";
  }
}

}  // namespace
}  // namespace gsv
