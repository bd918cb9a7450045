#include "ground_scale_vo/ros/frame_parents.hpp"

#include <gtest/gtest.h>

#include "ground_scale_vo/ros/frame_name.hpp"

namespace ground_scale_vo {
namespace {

tf2_msgs::TFMessage transform(const std::string& parent, const std::string& child) {
  tf2_msgs::TFMessage message;
  message.transforms.resize(1);
  message.transforms[0].header.frame_id = parent;
  message.transforms[0].child_frame_id = child;
  return message;
}

const FrameParents::Clock::time_point kNow{};

TEST(FrameParents, FindsAnotherParentAndTheRootOfItsStaticChain) {
  FrameParents parents;
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow), "");
  EXPECT_EQ(parents.staticRoot("camera"), "camera");
  parents.add(transform("odom", "camera"), false, kNow);
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow), "");
  parents.add(transform("mast", "/camera"), true, kNow);
  parents.add(transform("/base_link", "mast"), true, kNow);
  parents.add(transform("world", "base_link"), false, kNow);
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow), "mast");
  EXPECT_EQ(parents.staticRoot("camera"), "base_link");
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow + std::chrono::hours(1)), "mast");
}

TEST(FrameParents, ForgetsAParentThatIsNotBroadcastAnyMore) {
  FrameParents parents;
  parents.add(transform("world", "camera"), false, kNow);
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow + std::chrono::milliseconds(4900)), "world");
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow + std::chrono::milliseconds(5100)), "");
  // It does not hide one that is.
  const auto later = kNow + std::chrono::seconds(10);
  for (const char* parent : {"a", "z"}) parents.add(transform(parent, "camera"), false, kNow);
  parents.add(transform("mast", "camera"), false, later);
  EXPECT_EQ(parents.otherParent("camera", "odom", later), "mast");
}

TEST(FrameParents, RemembersAParentWhileItIsBroadcast) {
  FrameParents parents;
  for (const int second : {0, 4, 8}) {
    parents.add(transform("world", "camera"), false, kNow + std::chrono::seconds(second));
  }
  EXPECT_EQ(parents.otherParent("camera", "odom", kNow + std::chrono::seconds(12)), "world");
}

TEST(FrameParents, ACycleEnds) {
  FrameParents parents;
  parents.add(transform("a", "b"), true, kNow);
  parents.add(transform("b", "a"), true, kNow);
  EXPECT_NE(parents.staticRoot("a"), "");
}

TEST(FrameName, HasNoLeadingSlash) {
  std::string warning;
  const auto warn = [&](const std::string& sentence) { warning = sentence; };
  EXPECT_EQ(frameName("camera", "frame_id", warn), "camera");
  EXPECT_EQ(frameName("a/b", "frame_id", warn), "a/b");
  EXPECT_EQ(frameName("", "frame_id", warn), "");
  EXPECT_EQ(warning, "");
  EXPECT_EQ(frameName("/a/b", "frame_id", warn), "a/b");
  EXPECT_EQ(warning, "frame_id is \"/a/b\"; tf2 has no leading slash, \"a/b\" is used");
  EXPECT_EQ(frameName("//a", "frame_id", warn), "a");
  EXPECT_EQ(frameName("/", "frame_id", warn), "");
}

}  // namespace
}  // namespace ground_scale_vo
