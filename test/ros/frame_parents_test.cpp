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
  for (const char* name : {"camera", "a/b", ""}) {
    EXPECT_EQ(frameName(name, "frame_id", warn), name);
    EXPECT_EQ(warning, "");
  }
  EXPECT_EQ(frameName("/a/b", "frame_id", warn), "a/b");
  EXPECT_EQ(warning, "frame_id is \"/a/b\"; tf2 has no leading slash, \"a/b\" is used");
  EXPECT_EQ(frameName("//a", "frame_id", warn), "a");
  EXPECT_EQ(frameName("/", "frame_id", warn), "");
}

}  // namespace
}  // namespace ground_scale_vo
