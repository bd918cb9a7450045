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
  EXPECT_TRUE(queue.empty());
  EXPECT_FALSE(queue.pop());
  for (const int i : {1, 2, 3}) EXPECT_TRUE(queue.push(i));
  EXPECT_FALSE(queue.push(4));
  for (const int i : {2, 3, 4}) EXPECT_EQ(queue.pop(), i);
  EXPECT_TRUE(queue.empty());
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
constexpr Verdict kAccept = Verdict::kAccept, kDrop = Verdict::kDrop, kHold = Verdict::kHold,
                  kAhead = Verdict::kJumpedAhead, kBack = Verdict::kJumpedBack;

void expectVerdicts(StampGuard guard, const std::vector<std::pair<double, Verdict>>& stamps) {
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    EXPECT_EQ(guard.check(ros::Time(stamps[i].first)), stamps[i].second)
        << "stamp " << i << ": " << stamps[i].first << " s";
  }
}

TEST(StampGuard, DropsRepeatedAndSlightlyBackwardStamps) {
  expectVerdicts(
      StampGuard(1.0),
      {{0, kDrop}, {10, kAccept}, {10, kDrop}, {10.000999, kDrop}, {9.5, kDrop}, {10.1, kAccept}});
  StampGuard guard(1.0);
  guard.check(ros::Time(10.0));
  guard.check(ros::Time(10.0));
  EXPECT_EQ(guard.reason(),
            "the stamp 10.000000000 is not at least 0.001 s later than the last one, 10.000000000");
}

TEST(StampGuard, ASingleStampFarAwayIsRefuted) {
  std::vector<std::pair<double, Verdict>> stamps = {{20, kAccept}};
  double last = 20;
  for (const double jump : {2.0, 30.0, 7200.0, -1.5, -19.0}) {
    stamps.emplace_back(last + jump, kHold);
    stamps.emplace_back(last += 0.1, kAccept);
  }
  // Stamps from which the next one does not continue.
  for (const double stamp : {7210.0, 19000.0, 18999.0, 18999.0, 12.0, 11.0}) {
    stamps.emplace_back(stamp, kHold);
  }
  stamps.insert(stamps.end(), {{last + 0.1, kAccept}, {7210, kHold}, {0, kDrop}, {7210.1, kHold}});
  expectVerdicts(StampGuard(1.0), stamps);
}

TEST(StampGuard, AJumpIsAcceptedWhenTheNextStampContinuesFromIt) {
  expectVerdicts(StampGuard(1.0), {{10, kAccept},
                                   {7210, kHold},
                                   {7210.1, kAhead},
                                   {7210.2, kAccept},
                                   {10.3, kHold},
                                   {10.4, kBack},
                                   {10.5, kAccept}});
  expectVerdicts(StampGuard(1.0, false),
                 {{10, kAccept}, {5, kDrop}, {5.1, kDrop}, {10.1, kAccept}});
}

TEST(StampGuard, AcceptsImagesAtLongIntervals) {
  expectVerdicts(StampGuard(1.0), {{10, kAccept},
                                   {14, kHold},
                                   {18, kAhead},
                                   {22, kAccept},
                                   {28, kAccept},
                                   {37.1, kHold},
                                   {37, kAccept}});
  expectVerdicts(StampGuard(1.0), {{100, kAccept}, {10, kHold}, {14, kBack}, {18, kAccept}});
  expectVerdicts(StampGuard(0.0), {{10, kAccept}, {10.1, kHold}, {10.2, kAhead}, {10.3, kAccept}});
}

// ros::Duration ends at 2^31 s and throws beyond, so the guard must not use it.
TEST(StampGuard, WorksOverTheWholeRangeOfStamps) {
  constexpr auto kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  StampGuard guard(1.0);
  EXPECT_EQ(guard.check(ros::Time(1, 0)), kAccept);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 0)), kHold);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 998999999)), kAhead);
  EXPECT_EQ(guard.check(ros::Time(kMaxSeconds, 999999999)), kAccept);
  EXPECT_EQ(guard.check(ros::Time(0, 1)), kHold);
  EXPECT_EQ(guard.check(ros::Time(0, 1000001)), kBack);
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
  EXPECT_EQ(filtered(0.0, 3), Accepted());
  EXPECT_EQ(dropped, (std::vector<std::string>{
                         "the stamp 40.000000000 is 30 s after the last one and not confirmed by "
                         "the next one",
                         "the stamp is zero"}));
  EXPECT_EQ(filtered(40.0, 4), Accepted());
  EXPECT_EQ(filtered(40.1, 5), (Accepted{{4, false}, {5, false}}));
  EXPECT_EQ(filtered(10.0, 6), Accepted());
  EXPECT_EQ(filtered(10.1, 7), (Accepted{{6, true}, {7, false}}));
  EXPECT_EQ(dropped.size(), 2u);
}

TEST(SequenceCheck, CountsMissingFramesAndReportsNumbersThatCountNothing) {
  SequenceCheck check;
  for (const std::uint32_t sequence : {3u, 4u, 7u}) check.add(sequence);
  EXPECT_EQ(check.missing(), 2u);
  check.add(0);  // a restart
  EXPECT_EQ(check.error(), "");
  check.add(0);  // another one, before the second image
  EXPECT_EQ(check.error(), "");
  check.add(0);
  EXPECT_NE(check.error().find("sequence is 0 in two vo/frame in a row"), std::string::npos);
  constexpr auto kMost = std::numeric_limits<std::uint32_t>::max();
  check.add(kMost);
  EXPECT_EQ(check.error(),
            "sequence of vo/frame jumps from 0 to 4294967295: it must count the images");
  check.add(kMost);
  EXPECT_NE(check.error().find("sequence is 4294967295 in two vo"), std::string::npos);
  check.add(0);
  EXPECT_EQ(check.error(), "") << "the next number is valid";
  check.add(0);
  EXPECT_EQ(check.error(), "") << "the numbers before do not count";
  EXPECT_EQ(check.missing(), 2u);
}

TEST(WarningLog, CountsAllAndPrintsTheFirst) {
  WarningLog log(std::chrono::hours(1));
  EXPECT_EQ(log.count("image size", "too small"), "too small (image size: 1 so far)");
  EXPECT_EQ(log.count("image size", "too small"), "");
  EXPECT_NE(log.count("image stamp", "late"), "");
  EXPECT_NE(log.count("camera_info refused", "zeros"), "");
  EXPECT_EQ(log.counts().at("image size"), 2u);
  EXPECT_EQ(log.total("image "), 3u);
  EXPECT_EQ(log.total("camera_info "), 1u);
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

/// Applies the numbering to a frame whose rotation to the map has a sigma of 0.01 rad.
VoFrame numbered(MapNumbering* numbering, std::uint32_t sequence, std::uint32_t map_id) {
  VoFrame frame;
  frame.sequence = sequence;
  frame.map_id = map_id;
  frame.map_start.rotation_sigma = 0.01;
  numbering->apply(frame);
  return frame;
}

// The first map after a restart relates to its first image, not to the last pose before it.
TEST(MapNumbering, ARestartedOdometryHasNewMapsOfUnknownRotation) {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  const struct {
    std::uint32_t sequence, map_id, numbered_map_id;
    double rotation_sigma;
  } kFrames[] = {{0, 0, 0, 0.01},     {1, 0, 0, 0.01},     {5, 2, 2, 0.01}, {0, 0, 3, kUnknown},
                 {1, 0, 3, kUnknown}, {2, 1, 4, 0.01},     {2, 1, 4, 0.01}, {0, 0, 5, kUnknown},
                 {7, 3, 8, 0.01},     {5, 2, 11, kUnknown}};  // its maps 0 and 1 were not received
  MapNumbering numbering;
  for (const auto& frame : kFrames) {
    const VoFrame result = numbered(&numbering, frame.sequence, frame.map_id);
    EXPECT_EQ(result.map_id, frame.numbered_map_id);
    EXPECT_EQ(result.map_start.rotation_sigma, frame.rotation_sigma) << result.map_id;
  }
  // A trajectory that starts there, or at a restart, keeps the rotation.
  for (const std::uint32_t sequence : {6u, 0u, 1u}) {
    if (sequence != 1u) numbering.startTrajectory();
    EXPECT_EQ(numbered(&numbering, sequence, 2).map_start.rotation_sigma, 0.01) << sequence;
  }
}

geometry_msgs::PoseStamped poseAt(double x, double y = 0, double z = 0) {
  geometry_msgs::PoseStamped pose;
  pose.pose.position.x = x;
  pose.pose.position.y = y;
  pose.pose.position.z = z;
  return pose;
}

TEST(BoundedPath, StaysBoundedAndCoversTheWholeDrive) {
  for (const double spacing : {0.5, 0.0}) {
    BoundedPath path(100, spacing);
    for (int i = 0; i < 100000; ++i) path.add(poseAt(0.1 * i));
    const auto& poses = path.poses();
    EXPECT_LE(poses.size(), 100u);
    EXPECT_GE(poses.size(), 40u);
    EXPECT_EQ(poses.front().pose.position.x, 0);
    EXPECT_GT(poses.back().pose.position.x, 9500);
    // The whole drive has the same spacing.
    double shortest = 1e9, longest = 0;
    for (std::size_t i = 1; i < poses.size(); ++i) {
      const double step = poses[i].pose.position.x - poses[i - 1].pose.position.x;
      shortest = std::min(shortest, step);
      longest = std::max(longest, step);
    }
    EXPECT_LT(longest, 1.5 * shortest) << spacing;
  }
  BoundedPath of_standstill(2, 0);
  for (int i = 0; i < 1000; ++i) of_standstill.add(poseAt(0));
  EXPECT_LE(of_standstill.poses().size(), 2u);
}

TEST(BoundedPath, PosesAreApartInEachDirection) {
  BoundedPath path(100, 0.5);
  for (int i = 0; i < 1000; ++i) path.add(poseAt(i));
  path.clear();  // the initial spacing again
  EXPECT_TRUE(path.add(poseAt(0)));
  EXPECT_FALSE(path.add(poseAt(0.4)));
  EXPECT_TRUE(path.add(poseAt(0, 0, 0.6)));
  EXPECT_TRUE(path.add(poseAt(0.6)));
  EXPECT_TRUE(path.add(poseAt(0.6, -0.6)));
}

}  // namespace
}  // namespace ground_scale_vo
