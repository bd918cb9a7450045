#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/ros/bounded_path.hpp"
#include "ground_scale_vo/ros/bounded_queue.hpp"
#include "ground_scale_vo/ros/map_numbering.hpp"
#include "ground_scale_vo/ros/rate_meter.hpp"
#include "ground_scale_vo/ros/sequence_check.hpp"
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

TEST(RateMeter, IsTheMeanRateSinceTheLastCall) {
  const RateMeter::Clock::time_point start;
  const auto after = [&](int ms) { return start + std::chrono::milliseconds(ms); };
  RateMeter meter(start);
  EXPECT_EQ(meter.rate(0, start), 0);
  EXPECT_NEAR(meter.rate(10, after(500)), 20, 1e-9);
  EXPECT_NEAR(meter.rate(40, after(1500)), 30, 1e-9);
  EXPECT_EQ(meter.rate(40, after(2500)), 0);
}

using Verdict = StampGuard::Verdict;

TEST(StampGuard, DropsRepeatedAndSlightlyBackwardStamps) {
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
}

TEST(StampGuard, ASingleStampFarAwayIsRefuted) {
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(20.0)), Verdict::kAccept);
  double last = 20.0;
  for (const double jump : {2.0, 30.0, 3000.0, 7200.0, -1.5, -5.0, -19.0}) {
    EXPECT_EQ(guard.check(ros::Time(last + jump)), Verdict::kHold) << jump;
    EXPECT_EQ(guard.check(ros::Time(last += 0.1)), Verdict::kAccept) << jump;
  }
  // Stamps from which the next one does not continue.
  for (const double stamp : {7210.0, 19000.0, 18999.0, 18999.0, 12.0, 11.0}) {
    EXPECT_EQ(guard.check(ros::Time(stamp)), Verdict::kHold) << stamp;
  }
  EXPECT_EQ(guard.check(ros::Time(last += 0.1)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(7210.0)), Verdict::kHold);
  EXPECT_EQ(guard.reason(),
            "the stamp 7210.000000000 is 7189.2 s after the last one and not confirmed by the next "
            "one");
  EXPECT_EQ(guard.check(ros::Time()), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(7210.1)), Verdict::kHold);
}

TEST(StampGuard, AJumpIsAcceptedWhenTheNextStampContinuesFromIt) {
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(10.0)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(7210.0)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(7210.1)), Verdict::kJumpedAhead);
  EXPECT_EQ(guard.check(ros::Time(7210.2)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(10.3)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(10.4)), Verdict::kJumpedBack);
  EXPECT_EQ(guard.check(ros::Time(10.5)), Verdict::kAccept);
}

TEST(StampGuard, WorksWithImagesAtLongIntervals) {
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(10)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(14)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(18)), Verdict::kJumpedAhead);
  EXPECT_EQ(guard.check(ros::Time(22)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(28)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(37.1)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(37)), Verdict::kAccept);
  StampGuard always(0.0);
  EXPECT_EQ(always.check(ros::Time(10.0)), Verdict::kAccept);
  EXPECT_EQ(always.check(ros::Time(10.1)), Verdict::kHold);
  EXPECT_EQ(always.check(ros::Time(10.2)), Verdict::kJumpedAhead);
  EXPECT_EQ(always.check(ros::Time(10.3)), Verdict::kAccept);
}

TEST(StampGuard, AJumpBackAfterTheFirstOfImagesAtLongIntervalsIsAccepted) {
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(100)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(10)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(14)), Verdict::kJumpedBack);
  EXPECT_EQ(guard.check(ros::Time(18)), Verdict::kAccept);
}

TEST(StampGuard, DropsBackwardStampsIfItMayNotJumpBack) {
  StampGuard guard(1.0, false);
  EXPECT_EQ(guard.check(ros::Time(10.0)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(5.0)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(5.1)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(10.1)), Verdict::kAccept);
}

// ros::Duration ends at 2^31 s and throws beyond, so the guard must not use it.
TEST(StampGuard, WorksOverTheWholeRangeOfStamps) {
  constexpr auto kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(1, 0)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 0)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 998999999)), Verdict::kJumpedAhead);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 999999999)), Verdict::kAccept);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 999999999)), Verdict::kDrop);
  EXPECT_EQ(guard.check(ros::Time(0, 1)), Verdict::kHold);
  EXPECT_EQ(guard.check(ros::Time(0, 1000001)), Verdict::kJumpedBack);
}

TEST(StampFilter, PassesOnAHeldMessageWithTheOneThatConfirmsIt) {
  std::vector<std::string> dropped;
  StampFilter<int> filter(1.0, [&](const std::string& reason) { dropped.push_back(reason); });
  const auto filtered = [&](double stamp, int message) {
    std::vector<std::pair<int, bool>> accepted;
    for (const auto& one : filter.filter(ros::Time(stamp), message)) {
      accepted.emplace_back(one.message, one.clock_jumped_back);
    }
    return accepted;
  };
  using Accepted = std::vector<std::pair<int, bool>>;
  EXPECT_EQ(filtered(10.0, 1), (Accepted{{1, false}}));
  EXPECT_EQ(filtered(40.0, 2), Accepted());
  EXPECT_TRUE(dropped.empty());
  EXPECT_EQ(filtered(10.1, 3), (Accepted{{3, false}}));
  ASSERT_EQ(dropped.size(), 1u);
  EXPECT_EQ(dropped[0],
            "the stamp 40.000000000 is 30 s after the last one and not confirmed by the next one");
  EXPECT_EQ(filtered(0.0, 4), Accepted());
  EXPECT_EQ(dropped.size(), 2u);
  EXPECT_EQ(filtered(40.0, 5), Accepted());
  EXPECT_EQ(filtered(40.1, 6), (Accepted{{5, false}, {6, false}}));
  EXPECT_EQ(filtered(10.0, 7), Accepted());
  EXPECT_EQ(filtered(10.1, 8), (Accepted{{7, true}, {8, false}}));
  EXPECT_EQ(dropped.size(), 2u);
}

TEST(StampFilter, GivesTheReasonOfEachDroppedMessage) {
  std::vector<std::string> dropped;
  StampFilter<int> filter(1.0, [&](const std::string& reason) { dropped.push_back(reason); });
  for (const double stamp : {10.0, 40.0, 0.0}) filter.filter(ros::Time(stamp), 0);
  EXPECT_EQ(dropped, (std::vector<std::string>{
                         "the stamp 40.000000000 is 30 s after the last one and not confirmed by "
                         "the next one",
                         "the stamp is zero"}));
}

TEST(SequenceCheck, CountsMissingFramesAndReportsNumbersThatCountNothing) {
  SequenceCheck check;
  for (const std::uint32_t sequence : {3u, 4u, 7u}) check.add(sequence);
  EXPECT_EQ(check.missing(), 2u);
  check.add(0);  // a restart
  EXPECT_EQ(check.missing(), 2u);
  EXPECT_EQ(check.error(), "");
  check.add(0);  // another one, before the second image
  EXPECT_EQ(check.error(), "");
  check.add(0);
  EXPECT_NE(check.error().find("sequence is 0 in two vo/frame in a row"), std::string::npos);
  constexpr auto kMost = std::numeric_limits<std::uint32_t>::max();
  check.add(kMost);
  EXPECT_EQ(check.error(),
            "sequence of vo/frame jumps from 0 to 4294967295: it must count the images");
  for (int i = 0; i < 3; ++i) {
    check.add(kMost);
    EXPECT_NE(check.error().find("sequence is 4294967295 in two vo"), std::string::npos) << i;
  }
  check.add(0);
  EXPECT_EQ(check.error(), "") << "the next number is valid";
  check.add(0);
  EXPECT_EQ(check.error(), "") << "the numbers before do not count";
  EXPECT_EQ(check.missing(), 2u);
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

// A warning with every image does not postpone the next print.
TEST(WarningLog, PrintsAgainAfterTheInterval) {
  WarningLog log(std::chrono::milliseconds(300));
  const Stopwatch watch;
  ASSERT_NE(log.count("image refused", "why"), "");
  std::string text;
  while (text.empty() && watch.seconds() < 30) text = log.count("image refused", "why");
  EXPECT_NE(text, "");
  EXPECT_GE(watch.seconds(), 0.3);
}

TEST(WarningLog, CountsKindsByTheirPrefix) {
  WarningLog log(std::chrono::hours(1));
  for (const char* kind : {"image refused", "image stamp", "image stamp", "camera_info refused"}) {
    log.count(kind, "");
  }
  EXPECT_EQ(log.total("image "), 3u);
  EXPECT_EQ(log.total("camera_info "), 1u);
}

TEST(MapNumbering, ARestartedOdometryHasNewMaps) {
  MapNumbering numbering;
  std::vector<std::uint32_t> maps;
  const std::pair<std::uint32_t, std::uint32_t> kSequenceAndMap[] = {{0, 0}, {1, 0}, {5, 2}, {0, 0},
                                                                     {1, 1}, {1, 1}, {0, 0}};
  for (const auto& [sequence, map_id] : kSequenceAndMap) {
    VoFrame frame;
    frame.sequence = sequence;
    frame.map_id = map_id;
    numbering.apply(frame);
    maps.push_back(frame.map_id);
  }
  EXPECT_EQ(maps, (std::vector<std::uint32_t>{0, 0, 2, 3, 4, 4, 5}));
}

/// The sigma of the rotation to the map of a frame that the sender sent with 0.01 rad.
double rotationSigma(MapNumbering* numbering, std::uint32_t sequence, std::uint32_t map_id) {
  VoFrame frame;
  frame.sequence = sequence;
  frame.map_id = map_id;
  frame.map_start.rotation_sigma = 0.01;
  numbering->apply(frame);
  return frame.map_start.rotation_sigma;
}

// Its first map relates to its first image, not to the last pose before the restart.
TEST(MapNumbering, TheRotationToTheFirstMapAfterARestartIsUnknown) {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  MapNumbering numbering;
  EXPECT_EQ(rotationSigma(&numbering, 4, 0), 0.01);
  EXPECT_EQ(rotationSigma(&numbering, 5, 1), 0.01);
  EXPECT_EQ(rotationSigma(&numbering, 0, 0), kUnknown);
  EXPECT_EQ(rotationSigma(&numbering, 9, 0), kUnknown);
  EXPECT_EQ(rotationSigma(&numbering, 10, 1), 0.01);
  EXPECT_EQ(rotationSigma(&numbering, 0, 0), kUnknown);
  EXPECT_EQ(rotationSigma(&numbering, 7, 3), 0.01);
  EXPECT_EQ(rotationSigma(&numbering, 5, 2), kUnknown) << "its maps 0 and 1 were not received";
  numbering.startTrajectory();
  EXPECT_EQ(rotationSigma(&numbering, 6, 2), 0.01);
  numbering.startTrajectory();
  EXPECT_EQ(rotationSigma(&numbering, 1, 0), 0.01);
}

TEST(MapNumbering, ARestartTogetherWithTheTrajectoryKeepsTheRotation) {
  MapNumbering numbering;
  EXPECT_EQ(rotationSigma(&numbering, 5, 1), 0.01);
  numbering.startTrajectory();
  EXPECT_EQ(rotationSigma(&numbering, 0, 0), 0.01);
  EXPECT_EQ(rotationSigma(&numbering, 1, 0), 0.01);
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
  // The whole drive has the same spacing.
  double shortest = 1e9, longest = 0;
  for (std::size_t i = 1; i < path.poses().size(); ++i) {
    const double step = path.poses()[i].pose.position.x - path.poses()[i - 1].pose.position.x;
    shortest = std::min(shortest, step);
    longest = std::max(longest, step);
  }
  EXPECT_LT(longest, 1.5 * shortest);
  path.clear();
  path.add(poseAt(0));
  EXPECT_FALSE(path.add(poseAt(0.4)));
  geometry_msgs::PoseStamped above = poseAt(0);
  above.pose.position.z = 0.6;
  EXPECT_TRUE(path.add(above));
  EXPECT_TRUE(path.add(poseAt(0.6)));
  geometry_msgs::PoseStamped beside = poseAt(0.6);
  beside.pose.position.y = -0.6;
  EXPECT_TRUE(path.add(beside));
}

TEST(BoundedPath, CoversTheWholeDriveWithoutASpacing) {
  BoundedPath path(100, 0);
  for (int i = 0; i < 10000; ++i) path.add(poseAt(0.1 * i));
  const auto& poses = path.poses();
  ASSERT_GE(poses.size(), 40u);
  // Half of the poses are in the first half of the drive.
  EXPECT_NEAR(poses[poses.size() / 2].pose.position.x, 500, 50);
}

TEST(BoundedPath, StaysBoundedWithoutASpacing) {
  BoundedPath path(2, 0);
  for (int i = 0; i < 1000; ++i) path.add(poseAt(0));
  EXPECT_LE(path.poses().size(), 2u);
}

}  // namespace
}  // namespace ground_scale_vo
