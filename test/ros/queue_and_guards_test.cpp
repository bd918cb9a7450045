#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/ros/bounded_path.hpp"
#include "ground_scale_vo/ros/bounded_queue.hpp"
#include "ground_scale_vo/ros/frame_name.hpp"
#include "ground_scale_vo/ros/frame_parents.hpp"
#include "ground_scale_vo/ros/map_numbering.hpp"
#include "ground_scale_vo/ros/rate_meter.hpp"
#include "ground_scale_vo/ros/sequence_check.hpp"
#include "ground_scale_vo/ros/source_guard.hpp"
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
  RateMeter meter(start);
  EXPECT_EQ(meter.rate(0, start), 0);
  EXPECT_NEAR(meter.rate(10, start + std::chrono::milliseconds(500)), 20, 1e-9);
  EXPECT_NEAR(meter.rate(40, start + std::chrono::milliseconds(1500)), 30, 1e-9);
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
  check.add(4000000000);
  EXPECT_NE(check.error().find("jumps from 0 to 4000000000"), std::string::npos);
  check.add(0);
  EXPECT_EQ(check.error(), "") << "the next number is valid";
  EXPECT_EQ(check.missing(), 2u);
}

TEST(WarningLog, CountsAllAndPrintsTheFirstOfEachInterval) {
  WarningLog log(std::chrono::milliseconds(300));
  const Stopwatch watch;
  EXPECT_EQ(log.count("image size", "too small"), "too small (image size: 1 so far)");
  EXPECT_NE(log.count("image stamp", "late"), "");
  EXPECT_NE(log.count("camera_info refused", "zeros"), "");
  std::uint64_t counted = 2;
  // A warning with every image does not postpone the next print.
  for (; log.count("image size", "too small").empty(); ++counted) ASSERT_LT(watch.seconds(), 30);
  EXPECT_GE(watch.seconds(), 0.3);
  EXPECT_EQ(log.counts().at("image size"), counted);
  EXPECT_EQ(log.total("image "), counted + 1);
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
    path.clear();  // the initial spacing again
    EXPECT_TRUE(path.add(poseAt(0)));
    EXPECT_TRUE(path.add(poseAt(0, -0.6)));
    EXPECT_TRUE(path.add(poseAt(0, -0.6, 0.6)));
    EXPECT_EQ(path.add(poseAt(0.4, -0.6, 0.6)), spacing < 0.4);
  }
}

using Guard = SourceGuard<std::string>;
using SourceVerdict = Guard::Verdict;

TEST(SourceGuard, AChangeOfTheSourceIsAccepted) {
  Guard guard;
  for (const std::string source : {"a", "b", "c"}) {
    EXPECT_EQ(guard.check(source), SourceVerdict::kChanged);
    EXPECT_EQ(guard.check(source), SourceVerdict::kSame);
    EXPECT_EQ(guard.current(), source);
  }
  EXPECT_EQ(guard.other(), "b");
  EXPECT_FALSE(guard.keepsChanging());
}

TEST(SourceGuard, ASourceThatKeepsChangingStaysInUseUntilItSettles) {
  for (const bool returns : {false, true}) {  // every second message is the same
    Guard guard;
    for (const char* source : {"a", "b", "c"}) guard.check(source);
    for (int i = 0; i < 300; ++i) {
      EXPECT_EQ(guard.check(std::to_string(i)), SourceVerdict::kUnsettled);
      if (returns) {
        EXPECT_EQ(guard.check("c"), SourceVerdict::kSame);
      }
      EXPECT_TRUE(guard.keepsChanging());
      EXPECT_FALSE(guard.alternates());
      EXPECT_EQ(guard.current(), "c");
    }
    for (int i = 0; i < Guard::kMemory - 1; ++i) {
      EXPECT_NE(guard.check("d"), SourceVerdict::kChanged);
    }
    EXPECT_EQ(guard.check("d"), SourceVerdict::kChanged);
    EXPECT_FALSE(guard.keepsChanging());
  }
}

TEST(SourceGuard, TheFirstOfTwoAlternatingSourcesStaysInUse) {
  for (const int ratio : {2, 50}) {
    Guard guard;
    guard.check("a");
    guard.check("b");
    EXPECT_EQ(guard.check("a"), SourceVerdict::kChanged);
    EXPECT_FALSE(guard.alternates());
    for (int i = 0; i < 1000; ++i) {
      const bool is_second = i % ratio == 0;
      EXPECT_EQ(guard.check(is_second ? "b" : "a"),
                is_second ? SourceVerdict::kOther : SourceVerdict::kSame);
      EXPECT_TRUE(guard.alternates());
    }
  }
}

TEST(SourceGuard, ForgetsASourceThatHasEnded) {
  for (const std::string left : {"a", "b"}) {
    Guard guard;
    for (const char* source : {"a", "b", "a", "b"}) guard.check(source);
    EXPECT_TRUE(guard.alternates());
    for (int i = 0; i <= Guard::kMemory; ++i) guard.check(left);
    EXPECT_FALSE(guard.alternates());
    EXPECT_EQ(guard.current(), left);
    // Later, a change that is undone is not an alternation.
    for (int i = 0; i <= Guard::kMemory; ++i) guard.check(left);
    const std::string other = left == "a" ? "b" : "a";
    for (const auto& source : {other, left})
      EXPECT_EQ(guard.check(source), SourceVerdict::kChanged);
    EXPECT_FALSE(guard.alternates());
  }
}

tf2_msgs::TFMessage transform(const std::string& parent, const std::string& child) {
  tf2_msgs::TFMessage message;
  message.transforms.resize(1);
  message.transforms[0].header.frame_id = parent;
  message.transforms[0].child_frame_id = child;
  return message;
}

FrameParents::Clock::time_point at(double seconds) {
  return FrameParents::Clock::time_point(
      std::chrono::milliseconds(static_cast<int>(1000 * seconds)));
}

TEST(FrameParents, FindsAnotherParentAndTheRootOfItsStaticChain) {
  FrameParents parents;
  EXPECT_EQ(parents.otherParent("camera", "odom", at(0)), "");
  EXPECT_EQ(parents.staticRoot("camera"), "camera");
  parents.add(transform("odom", "camera"), false, at(0));
  EXPECT_EQ(parents.otherParent("camera", "odom", at(0)), "");
  parents.add(transform("mast", "/camera"), true, at(0));
  parents.add(transform("/base_link", "mast"), true, at(0));
  parents.add(transform("world", "base_link"), false, at(0));
  EXPECT_EQ(parents.otherParent("camera", "odom", at(3600)), "mast");
  EXPECT_EQ(parents.staticRoot("camera"), "base_link");
  parents.add(transform("camera", "base_link"), true, at(0));
  EXPECT_NE(parents.staticRoot("camera"), "") << "of a cycle";
}

TEST(FrameParents, ForgetsAParentThatIsNotBroadcastAnyMore) {
  FrameParents parents;
  for (const int second : {0, 4, 8}) parents.add(transform("w", "camera"), false, at(second));
  EXPECT_EQ(parents.otherParent("camera", "odom", at(12.9)), "w");
  EXPECT_EQ(parents.otherParent("camera", "odom", at(13.1)), "");
  // It does not hide one that is.
  for (const char* parent : {"a", "z"}) parents.add(transform(parent, "camera"), false, at(8));
  parents.add(transform("mast", "camera"), false, at(20));
  EXPECT_EQ(parents.otherParent("camera", "odom", at(20)), "mast");
}

TEST(FrameName, HasNoLeadingSlash) {
  std::string warning;
  const auto warn = [&](const std::string& sentence) { warning = sentence; };
  EXPECT_EQ(frameName("a/b", "frame_id", warn), "a/b");
  EXPECT_EQ(warning, "");
  EXPECT_EQ(frameName("//a/b", "frame_id", warn), "a/b");
  EXPECT_EQ(warning, "frame_id is \"//a/b\"; tf2 has no leading slash, \"a/b\" is used");
  EXPECT_EQ(frameName("/", "frame_id", warn), "");
}

}  // namespace
}  // namespace ground_scale_vo
