// Both nodelets under use_sim_time: a clock that starts late, a looped bag, single wrong
// stamps.

#include <rosgraph_msgs/Clock.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "manager_test.hpp"

namespace gsv {
namespace {

/// One pair of nodelets for all tests.
class Time : public DriveTest<50> {
 protected:
  static void TearDownTestSuite() {
    pair_.reset();
    clock_.shutdown();
    DriveTest::TearDownTestSuite();
  }
  void SetUp() override {
    ManagerTest::SetUp();
    if (!pair_) {
      clock_ = handle_.advertise<rosgraph_msgs::Clock>("/clock", 10);
      pair_ = std::make_unique<NodeletPair>(manager_, *drive_, "");
      ASSERT_TRUE(pair_->load());
    }
    // The clock has two subscribers: this test and the manager.
    ASSERT_TRUE(waitUntil([this] {
      return clock_.getNumSubscribers() >= 2 && tf_.connected() && diagnostics_.connected();
    }));
  }
  void TearDown() override {}

  /// Starts a pass of the drive with its first images, which follow no others: the first one is
  /// held until the next one confirms its stamp.
  bool start(double start_s, std::size_t images) {
    clear();
    pair_->start_s = start_s;
    return pair_->play(0, images - 1, true);
  }
  void setClock(const ros::Time& now) {
    rosgraph_msgs::Clock clock;
    clock.clock = now;
    clock_.publish(clock);
    ASSERT_TRUE(waitUntil([&] { return ros::Time::now() == clock.clock; }));
  }
  /// Plays the images, the first one after a jump; each after the clock, which is behind its stamp.
  bool playWithClock(double start_s, std::size_t clock_from = 0, double clock_behind_s = 0) {
    pair_->start_s = start_s;
    for (std::size_t i = 0; i < kFrames; ++i) {
      if (i >= clock_from) setClock(pair_->stamp(i) - ros::Duration(clock_behind_s));
      pair_->publish(i);
      if (i > 0 && !pair_->waitForResult(i)) return false;
    }
    return pair_->odometry.waitForStamp(pair_->lastStamp());
  }
  bool waitForTf(const ros::Time& stamp) {
    return tf_.wait([&stamp](const auto& messages) {
      return !messages.empty() && messages.back()->transforms.at(0).header.stamp == stamp;
    });
  }
  void clear() {
    pair_->clear();
    tf_.clear();
  }

  TopicRecorder<tf2_msgs::TFMessage> tf_{handle_, "/tf"};
  static inline ros::Publisher clock_;
  static inline std::unique_ptr<NodeletPair> pair_;
};

// Runs first. A driver stamps with zero then.
TEST_F(Time, AMissingClockIsNamed) {
  ASSERT_TRUE(ros::Time::now().isZero());
  const std::string text = "/use_sim_time is true, but no time was received on /clock";
  EXPECT_TRUE(diagnostics_.waitForSummary("mono_vo", Status::ERROR, text));
  pair_->publishInfo(*drive_->info(ros::Time()));
  pair_->publishImage(0, ros::Time());
  EXPECT_TRUE(waitForLine("the stamp is zero; " + text));
}

// Before the clock runs. Three passes over the same stamps, as of a looped bag: the first without a
// clock, the second with a clock that starts then, the third after the clock has jumped back.
TEST_F(Time, ALateClockAndEachLoopOfABagGiveTheSameResults) {
  ASSERT_TRUE(ros::Time::now().isZero());
  std::vector<nav_msgs::Odometry::ConstPtr> first;
  std::uint32_t map_id = 0;
  for (int pass = 0; pass < 3; ++pass) {
    SCOPED_TRACE(pass);
    if (pass == 2) setClock(pair_->lastStamp() + ros::Duration(30));
    tf2_ros::Buffer buffer;
    const tf2_ros::TransformListener listener(buffer, handle_);
    clear();
    ASSERT_TRUE(playWithClock(1000, pass == 0 ? kFrames : 0));
    ASSERT_TRUE(waitForTf(pair_->lastStamp()));
    EXPECT_TRUE(diagnostics_.waitForValues("scale_recovery", {{"images", "used"}}));

    const auto frames = pair_->frames.messages();
    ASSERT_EQ(frames.size(), kFrames);
    for (std::size_t i = 0; i < kFrames; ++i) EXPECT_EQ(frames[i]->sequence, i);
    EXPECT_EQ(pair_->scales.count(), kFrames);
    if (pass > 0) {
      EXPECT_GT(pair_->scales.first()->map_id, map_id);
    }
    map_id = pair_->scales.last()->map_id;

    const auto odometry = pair_->odometry.messages();
    if (pass == 0) first = odometry;
    ASSERT_GT(first.size(), kFrames / 2);
    ASSERT_EQ(odometry.size(), first.size());
    EXPECT_EQ(tf_.count(), odometry.size());  // nothing of the previous pass
    for (std::size_t k = 0; k < first.size(); ++k) {
      // Each loop gives identical results.
      nav_msgs::Odometry again = *odometry[k];
      again.header.seq = first[k]->header.seq;
      EXPECT_EQ(again, *first[k]) << k;
    }
    // tf2 clears a listener when the clock jumps; this one exists since the start of the pass.
    const nav_msgs::Odometry& last = *odometry.back();
    ASSERT_TRUE(waitUntil([&] {
      return buffer.canTransform("odom", "camera", last.header.stamp, ros::Duration(0));
    }));
    EXPECT_EQ(buffer.lookupTransform("odom", "camera", last.header.stamp).transform,
              toTransformMsg(last).transform);
  }
}

// Frames that are late when the clock jumps back would be in the future of the new pass: tf2 would
// then ignore the transforms of all of it.
TEST_F(Time, LateFramesOfTheLastPassAreNotOnTf) {
  constexpr std::size_t kBefore = 40;
  constexpr double kStart = 41000;
  setClock(ros::Time(kStart));
  ASSERT_TRUE(start(kStart, kBefore));
  // The clock of bags may jump a little; not a loop.
  setClock(ros::Time(kStart - 0.5));
  ASSERT_TRUE(pair_->publishAndWait(kBefore));
  const ros::Time last_on_tf = pair_->stamp(kBefore);
  ASSERT_TRUE(waitForTf(last_on_tf));

  const ros::Time again(kStart - 100);
  setClock(again);
  ASSERT_TRUE(diagnostics_.wait([&](const auto& messages) {  // the nodelets have that time, too
    return !messages.empty() && messages.back()->header.stamp == again;
  }));
  ASSERT_TRUE(pair_->playUntilPose(kBefore + 1, kFrames - 1));
  ASSERT_TRUE(playWithClock(again.toSec()));
  ASSERT_TRUE(waitForTf(pair_->lastStamp()));
  ros::Time latest;
  for (const auto& message : tf_.messages()) {
    latest = std::max(latest, message->transforms.at(0).header.stamp);
  }
  EXPECT_EQ(latest, last_on_tf);
}

// The clock of the new pass comes after its first images; and stamps that are always ahead of it.
TEST_F(Time, TheNewPassIsOnTf) {
  constexpr double kStart = 31000;
  const struct {
    double start_s;
    std::size_t clock_from;
    double clock_behind_s;
  } kPasses[] = {{kStart, 0, 10}, {kStart - 100, 0, 10}, {kStart - 200, 20, 0}};
  for (const auto& pass : kPasses) {
    SCOPED_TRACE(pass.start_s);
    clear();
    ASSERT_TRUE(playWithClock(pass.start_s, pass.clock_from, pass.clock_behind_s));
    const std::size_t poses = pair_->odometry.count();
    EXPECT_GT(poses, kFrames / 2);
    EXPECT_TRUE(tf_.wait([&](const auto& messages) { return messages.size() == poses; }));
  }
}

// Both nodelets drop and count such a message, and one with a repeated, an earlier or no stamp;
// nothing is reset.
TEST_F(Time, InvalidStampsAreDroppedAndCounted) {
  const ros::Time most(std::numeric_limits<std::uint32_t>::max(), 0), none;
  ASSERT_TRUE(start(1000, 3));
  const std::uint32_t map_id = pair_->scales.last()->map_id;
  for (const ros::Time& stamp : {most, none, pair_->stamp(2), pair_->stamp(1)}) {
    pair_->publishImage(3, stamp);
    if (stamp == most) {
      ASSERT_TRUE(pair_->publishAndWait(3));  // refutes the jump
    }
  }
  ASSERT_TRUE(pair_->publishAndWait(4));
  EXPECT_EQ(pair_->frames.last()->sequence, 4u);
  EXPECT_EQ(pair_->scales.last()->map_id, map_id);
  EXPECT_TRUE(diagnostics_.waitForValues("mono_vo", {{"dropped: image stamp", "5"}}));

  // MonoVo publishes no frames with such stamps, so this test does.
  ros::Publisher frames = handle_.advertise<VoFrameMsg>("vo/frame", 10);
  ASSERT_TRUE(waitUntil([&] { return frames.getNumSubscribers() > 1; }));
  VoFrameMsg frame = *pair_->frames.last();
  frame.map_start = ros::Time();  // unknown; a map cannot start after its frame
  const auto publishFrame = [&](const ros::Time& stamp) {
    frame.header.stamp = stamp;
    ++frame.sequence;
    frames.publish(frame);
  };
  for (const ros::Time& stamp : {most, none, pair_->stamp(0)}) publishFrame(stamp);
  EXPECT_TRUE(diagnostics_.waitForValues("scale_recovery", {{"dropped: frame stamp", "3"}}));
  ASSERT_TRUE(pair_->publishAndWait(5));
}

}  // namespace
}  // namespace gsv
