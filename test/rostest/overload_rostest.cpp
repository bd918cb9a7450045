// Overload and stalled subscribers: the newest images are processed, dropped ones are counted, the
// scale stays correct, and subscribers do not affect the results.

#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>

#include <filesystem>
#include <memory>

#include "child_process.hpp"
#include "drive_test.hpp"
#include "node_probe.hpp"
#include "stalled_subscriber.hpp"

namespace ground_scale_vo {
namespace {

using Overload = DriveTest<60>;

// A burst arrives while MonoVo waits for its camera_info, so that the result does not depend on the
// speed of the machine.
TEST_F(Overload, TheNewestImagesAreProcessedAndTheOthersCounted) {
  NodeletPair pair(manager_, *drive_, "/burst");
  pair.setParam("mono_vo", "queue_size", 4);
  ASSERT_TRUE(pair.load());
  for (std::size_t i = 0; i < kFrames; ++i) pair.publishImage(i);
  ASSERT_TRUE(waitForValue(diagnostics_, "images received", std::to_string(kFrames)));
  pair.publishInfo(0);
  ASSERT_TRUE(pair.waitForResult(kFrames - 1));
  const auto frames = pair.frames.messages();
  ASSERT_EQ(frames.size(), 4u);
  EXPECT_EQ(frames.front()->header.stamp, pair.header(kFrames - 4).stamp);
  EXPECT_TRUE(
      waitForValue(diagnostics_, "images dropped, queue full", std::to_string(kFrames - 4)));
  EXPECT_TRUE(pair.unload());
}

// The camera is three times too fast: two of three images are dropped.
TEST_F(Overload, TheScaleStaysCorrectOverTheGaps) {
  SyntheticDrive::Options fast = smallDrive(3 * static_cast<int>(kFrames));
  fast.frame_rate_hz = 30;
  const RenderedDrive drive(fast);
  NodeletPair pair(manager_, drive, "/gaps");
  pair.setParam("mono_vo", "queue_size", 1);
  ASSERT_TRUE(pair.load());
  // Bursts of three; the next one after the result of the newest image.
  for (std::size_t i = 0; i < drive.size(); i += 3) {
    for (std::size_t k = i; k < i + 3; ++k) pair.publish(k);
    ASSERT_TRUE(pair.waitForResult(i + 2)) << i;
  }
  EXPECT_TRUE(waitForSummary(diagnostics_, "gaps/mono_vo", diagnostic_msgs::DiagnosticStatus::WARN,
                             "images dropped in the last second", false));
  ASSERT_TRUE(pair.odometry.waitForStamp(pair.header(drive.size() - 1).stamp));
  EXPECT_LT(pair.frames.messages().size(), drive.size());
  EXPECT_NEAR(pair.displacementRatio(), 1, kTolerance);
  EXPECT_TRUE(pair.unload());
}

// The same for ScaleRecovery: frames in a full queue are dropped, oldest first, and counted.
TEST_F(Overload, ScaleRecoveryDropsTheOldestFramesAndCountsThem) {
  // Records the frames of MonoVo for the drive.
  NodeletPair recorder(manager_, *drive_, "/recorded");
  ASSERT_TRUE(recorder.load());
  ASSERT_TRUE(recorder.playAll());
  ASSERT_TRUE(recorder.frames.waitForCount(kFrames));
  const auto frames = recorder.frames.messages();
  EXPECT_TRUE(recorder.unload());

  ros::Publisher publisher = handle_.advertise<VoFrameMsg>("/late/vo/frame", 1000);
  TopicRecorder<ScaleEstimateMsg> scales(handle_, "/late/scale");
  TopicRecorder<nav_msgs::Odometry> odometry(handle_, "/late/odometry");
  ros::param::set("/late/scale_recovery/camera_height", 1.65);
  ros::param::set("/late/scale_recovery/refine", false);
  ros::param::set("/late/scale_recovery/queue_size", 2);
  ASSERT_TRUE(manager_.load("ScaleRecovery", "/late/scale_recovery"));
  ASSERT_TRUE(waitUntil([&] {
    return publisher.getNumSubscribers() == 1 && scales.connected() && odometry.connected();
  }));
  for (std::size_t i = 0; i < kFrames; ++i) {
    // Two of three are not published.
    if (i % 3 == 2) {
      publisher.publish(frames[i]);
      ASSERT_TRUE(scales.waitForStamp(frames[i]->header.stamp)) << i;
    }
  }
  EXPECT_TRUE(waitForSummary(diagnostics_, "late/scale_recovery",
                             diagnostic_msgs::DiagnosticStatus::WARN,
                             "frames dropped in the last second", false));
  EXPECT_TRUE(waitForValue(diagnostics_, "frames dropped, queue full",
                           std::to_string(2 * (kFrames / 3 - 1))));
  ASSERT_TRUE(odometry.waitForStamp(frames.back()->header.stamp));
  EXPECT_NEAR(recorder.displacementRatio(odometry.messages()), 1, 2 * kTolerance);

  // A burst: the last frame is processed, and each other one is processed or counted as dropped. It
  // is shorter than clock_jump_s: whatever the queue drops, no gap in it is a jump of the clock.
  constexpr std::uint32_t burst = 400;
  VoFrameMsg::Ptr last;
  for (std::uint32_t i = 1; i <= burst; ++i) {
    last = boost::make_shared<VoFrameMsg>(*frames.back());
    last->sequence += i;
    last->header.stamp += ros::Duration(0.002 * i);
    publisher.publish(last);
  }
  ASSERT_TRUE(scales.waitForStamp(last->header.stamp));
  // The count of dropped frames starts with the first one received, the third of the drive.
  EXPECT_TRUE(waitForStatus(diagnostics_, [](const auto& status) {
    const int dropped = countIn(status, "frames dropped, queue full");
    return dropped > int{2 * (kFrames / 3 - 1)} &&
           dropped + countIn(status, "frames processed") == int{kFrames - 2 + burst};
  }));
  EXPECT_TRUE(manager_.unload("/late/scale_recovery"));
}

// One subscriber is stopped and never reads its sockets; others connect and disconnect.
TEST_F(Overload, SubscribersDoNotAffectTheResults) {
  NodeletPair alone(manager_, *drive_, "/alone");
  ASSERT_TRUE(alone.load());
  ASSERT_TRUE(alone.playAll());
  EXPECT_TRUE(alone.unload());

  NodeletPair watched(manager_, *drive_, "/watched");
  ASSERT_TRUE(watched.load());
  ChildProcess stalled(
      {std::filesystem::read_symlink("/proc/self/exe").string(), kSubscribe, "/watched"});
  ASSERT_TRUE(waitUntil([&] { return stalled.output().find(kSubscribe) != std::string::npos; }));
  stalled.send(SIGSTOP);
  const NodeProbe probe("/manager");
  const double rss_mb = probe.usage().rss_mb;
  for (std::size_t i = 0; i < kFrames; i += 10) {
    std::unique_ptr<TopicRecorder<sensor_msgs::Image>> tracks;
    std::unique_ptr<TopicRecorder<sensor_msgs::PointCloud2>> points, ground;
    std::unique_ptr<TopicRecorder<nav_msgs::Path>> path;
    if (i % 20 == 0) {
      tracks =
          std::make_unique<TopicRecorder<sensor_msgs::Image>>(handle_, "/watched/vo/image_tracks");
      points =
          std::make_unique<TopicRecorder<sensor_msgs::PointCloud2>>(handle_, "/watched/vo/points");
      ground = std::make_unique<TopicRecorder<sensor_msgs::PointCloud2>>(handle_,
                                                                         "/watched/ground_points");
      path = std::make_unique<TopicRecorder<nav_msgs::Path>>(handle_, "/watched/path");
      ASSERT_TRUE(waitUntil([&] {
        return tracks->connected() && points->connected() && ground->connected() &&
               path->connected();
      }));
    }
    for (std::size_t k = i; k < i + 10; ++k) {
      watched.publish(k);
      ASSERT_TRUE(watched.waitForResult(k)) << k;
    }
    if (tracks) {
      EXPECT_TRUE(tracks->waitForCount(1));
    }
  }
  ASSERT_TRUE(watched.odometry.waitForStamp(watched.header(kFrames - 1).stamp));
  const auto before = alone.odometry.messages(), now = watched.odometry.messages();
  ASSERT_EQ(now.size(), before.size());
  for (std::size_t i = 0; i < now.size(); ++i) {
    EXPECT_EQ(now[i]->pose.pose, before[i]->pose.pose) << i;
  }
  if (!kSanitized) {
    EXPECT_LT(probe.usage().rss_mb - rss_mb, 60);  // [MiB]
  }
  EXPECT_NEAR(watched.displacementRatio(), 1, kTolerance);
  EXPECT_TRUE(watched.unload());
}

}  // namespace
}  // namespace ground_scale_vo
