#include <gtest/gtest.h>

#include <chrono>
#include <limits>

#include "ground_scale_vo/ros/bounded_path.hpp"
#include "ground_scale_vo/ros/bounded_queue.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "ground_scale_vo/ros/warning_log.hpp"

namespace ground_scale_vo {
namespace {

TEST(BoundedQueue, KeepsOrderAndDropsTheOldest) {
  BoundedQueue<int> queue(3);
  EXPECT_TRUE(queue.push(1));
  EXPECT_TRUE(queue.push(2));
  EXPECT_TRUE(queue.push(3));
  EXPECT_FALSE(queue.push(4));
  EXPECT_EQ(queue.pop(), 2);
  EXPECT_EQ(queue.pop(), 3);
  EXPECT_EQ(queue.pop(), 4);
}

TEST(BoundedQueue, EmptyGivesNothing) {
  BoundedQueue<int> queue(1);
  EXPECT_TRUE(queue.empty());
  EXPECT_FALSE(queue.pop());
  queue.push(1);
  EXPECT_FALSE(queue.empty());
  EXPECT_EQ(queue.pop(), 1);
  EXPECT_FALSE(queue.pop());
}

TEST(StampGuard, DropsRepeatedStampsAndDetectsAClockJump) {
  using Verdict = StampGuard::Verdict;
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time()), Verdict::kDrop);
  EXPECT_EQ(guard.reason(), "the stamp is zero");
  EXPECT_EQ(guard.check(ros::Time(10.0)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(10.0)), Verdict::kDrop);
  EXPECT_EQ(guard.reason(),
            "the stamp 10.000000000 is not at least 0.001 s later than the last one, 10.000000000");
  EXPECT_EQ(guard.check(ros::Time(10, 999999)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(9.5)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(10.1)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(60.0)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(10.0)), Verdict::kJumpedBack);
  EXPECT_EQ(guard.check(ros::Time(10.1)), Verdict::kAccept);
}

TEST(StampGuard, AcceptsAStampFarAheadWhenASecondOneConfirmsIt) {
  using Verdict = StampGuard::Verdict;
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(10.0)), Verdict::kAccept);
  // A single stamp far ahead is a fault.
  EXPECT_EQ(guard.check(ros::Time(7210.0)), Verdict::kDrop);
  EXPECT_EQ(
      guard.reason(),
      "the stamp 7210.000000000 is 7200 s after the last one and not confirmed by a second one");
  EXPECT_EQ(guard.check(ros::Time(10.1)), Verdict::kAccept);
  // Stamps far ahead from which the next one does not continue.
  EXPECT_EQ(guard.check(ros::Time(7210.0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(19000.0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(18999.0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(18999.0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(10.2)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(7210.0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time()), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(7210.1)), Verdict::kDrop);
  // The next one continues: the camera paused.
  EXPECT_EQ(guard.check(ros::Time(7210.2)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(7210.3)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(10.3)), Verdict::kJumpedBack);
}

// ros::Duration ends at 2^31 s and throws beyond, so the guard must not use it.
TEST(StampGuard, WorksOverTheWholeRangeOfStamps) {
  using Verdict = StampGuard::Verdict;
  constexpr auto kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(1, 0)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 998999999)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 999999999)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 999999999)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(0, 1)), Verdict::kJumpedBack);
  EXPECT_EQ(guard.check(ros::Time(0, 1000001)), Verdict::kAccept);
}

TEST(WarningLog, CountsAllAndPrintsTheFirst) {
  WarningLog log(std::chrono::hours(1));
  EXPECT_EQ(log.count("size", "too small"), "too small (size: 1 so far)");
  EXPECT_EQ(log.count("size", "too small"), "");
  EXPECT_NE(log.count("stamp", "late"), "");
  EXPECT_EQ(log.counts().at("size"), 2u);
  WarningLog without_throttle(std::chrono::milliseconds(0));
  without_throttle.count("size", "a");
  EXPECT_EQ(without_throttle.count("size", "b"), "b (size: 2 so far)");
}

geometry_msgs::PoseStamped poseAt(double x) {
  geometry_msgs::PoseStamped pose;
  pose.pose.position.x = x;
  return pose;
}

TEST(BoundedPath, StaysBoundedAndCoversTheWholeDrive) {
  BoundedPath path(100, 0.5);
  for (int i = 0; i < 100000; ++i) path.add(poseAt(0.1 * i));
  EXPECT_LE(path.poses().size(), 100u);
  EXPECT_GE(path.poses().size(), 40u);
  EXPECT_EQ(path.poses().front().pose.position.x, 0);
  EXPECT_GT(path.poses().back().pose.position.x, 9500);
  path.clear();
  path.add(poseAt(0));
  EXPECT_FALSE(path.add(poseAt(0.4)));
  EXPECT_TRUE(path.add(poseAt(0.6)));
}

TEST(BoundedPath, StaysBoundedWithoutASpacing) {
  BoundedPath path(2, 0);
  for (int i = 0; i < 1000; ++i) path.add(poseAt(0));
  EXPECT_LE(path.poses().size(), 2u);
}

}  // namespace
}  // namespace ground_scale_vo
