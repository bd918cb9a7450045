// Overload, stalled subscribers, and unloading at any moment: the newest images are processed,
// dropped ones are counted, the scale stays correct, subscribers do not affect the results, and
// nothing of an unloaded nodelet is left.

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>

#include "child_process.hpp"
#include "manager_test.hpp"
#include "node_probe.hpp"
#include "stalled_subscriber.hpp"

namespace ground_scale_vo {
namespace {

// A camera that is three times too fast.
class Overload : public DriveTest<120, 30> {};

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
  EXPECT_NEAR(pair.displacementRatio(), 1, kTolerance);
  EXPECT_TRUE(pair.unload());
}

// The same for ScaleRecovery: frames in a full queue are dropped, oldest first, and counted.
TEST_F(Overload, ScaleRecoveryDropsTheOldestFramesAndCountsThem) {
  // Records the frames of MonoVo for the drive.
  NodeletPair recorder(manager_, *drive_, "/recorded");
  ASSERT_TRUE(recorder.load());
  ASSERT_TRUE(recorder.playAll());
  const auto frames = recorder.frames.messages();
  ASSERT_EQ(frames.size(), kFrames);
  EXPECT_TRUE(recorder.unload());

  NodeletPair late(manager_, *drive_, "/late");
  ros::Publisher publisher = handle_.advertise<VoFrameMsg>("/late/vo/frame", 1000);
  late.setParam("scale_recovery", "refine", false);
  late.setParam("scale_recovery", "queue_size", 2);
  ASSERT_TRUE(late.loadScaleRecovery());
  ASSERT_TRUE(waitUntil([&] {
    return publisher.getNumSubscribers() == 2 && late.scales.connected() &&
           late.odometry.connected();
  }));
  for (std::size_t i = 2; i < kFrames; i += 3) {  // two of three are not published
    publisher.publish(frames[i]);
    ASSERT_TRUE(late.scales.waitForStamp(late.stamp(i))) << i;
  }
  EXPECT_TRUE(diagnostics_.waitForSummary("late/scale_recovery", Status::WARN,
                                          "frames dropped in the last second", false));
  constexpr int kGaps = 2 * (static_cast<int>(kFrames) / 3 - 1);
  EXPECT_TRUE(diagnostics_.waitForValues("late/scale_recovery",
                                         {{"frames dropped, queue full", std::to_string(kGaps)}}));
  ASSERT_TRUE(late.odometry.waitForStamp(late.lastStamp()));
  EXPECT_NEAR(late.displacementRatio(), 1, 2 * kTolerance);

  // A burst: the last frame is processed, and each other one is processed or counted as dropped. It
  // is shorter than clock_jump_s: whatever the queue drops, no gap in it is a jump of the clock.
  constexpr int kBurst = 400;
  VoFrameMsg::Ptr last;
  for (int i = 1; i <= kBurst; ++i) {
    last = boost::make_shared<VoFrameMsg>(*frames.back());
    last->sequence += static_cast<std::uint32_t>(i);
    last->header.stamp += ros::Duration(0.002 * i);
    publisher.publish(last);
  }
  ASSERT_TRUE(late.scales.waitForStamp(last->header.stamp));
  // The count of dropped frames starts with the first one received, the third of the drive.
  EXPECT_TRUE(diagnostics_.waitForStatus("late/scale_recovery", [](const Status& status) {
    const int dropped = static_cast<int>(numberIn(status, "frames dropped, queue full"));
    return dropped > kGaps && dropped + static_cast<int>(numberIn(status, "frames processed")) ==
                                  static_cast<int>(kFrames) - 2 + kBurst;
  }));
  EXPECT_TRUE(manager_.unload("/late/scale_recovery"));
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
  ChildProcess stalled(
      {std::filesystem::read_symlink("/proc/self/exe").string(), kSubscribe, "/watched"});
  ASSERT_TRUE(waitUntil([&] { return stalled.output().find(kSubscribe) != std::string::npos; }));
  stalled.send(SIGSTOP);
  const NodeProbe probe(manager_.name());
  const double rss_mb = probe.usage().rss_mb;
  for (std::size_t i = 0; i < kPlayed; i += kPart) {
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
    EXPECT_LT(probe.usage().rss_mb - rss_mb, 60);  // [MiB]
  }
  EXPECT_TRUE(watched.unload());
}

// Both nodelets, unloaded in either order while they process images.
TEST_F(Overload, UnloadingIsCleanWhileImagesArrive) {
  constexpr int kReloads = 50, kWarmUpReloads = 15;
  constexpr double kMaxGrowth = 4;  // of the memory after the warm-up [MiB]; measured: 0.04
  const std::string nodelets[] = {"/mono_vo", "/scale_recovery"};
  const NodeProbe manager(manager_.name());
  const std::set<std::string> registered = manager.registrations();
  ros::param::set("/scale_recovery/camera_height", 1.65);
  TopicRecorder<VoFrameMsg> frames(handle_, "vo/frame");
  std::size_t threads = 0;
  double rss_mb = 0;
  {
    const RepeatingCamera camera(*drive_);
    for (int i = 0; i < kReloads; ++i) {
      if (i == kWarmUpReloads) {
        threads = manager.threads();
        rss_mb = manager.usage().rss_mb;
      }
      ASSERT_TRUE(manager_.load("MonoVo", nodelets[0]));
      ASSERT_TRUE(manager_.load("ScaleRecovery", nodelets[1]));
      frames.clear();
      EXPECT_TRUE(frames.waitForCount(static_cast<std::size_t>(1 + i % 3))) << "load " << i;
      ASSERT_TRUE(manager_.unload(nodelets[i % 2]));
      ASSERT_TRUE(manager_.unload(nodelets[1 - i % 2]));
    }
  }
  EXPECT_EQ(manager.registrations(), registered);
  EXPECT_LE(manager.threads(), threads);
  if (!kSanitized) {
    EXPECT_LT(manager.usage().rss_mb - rss_mb, kMaxGrowth) << "from " << rss_mb << " MiB";
  }
}

}  // namespace
}  // namespace ground_scale_vo
