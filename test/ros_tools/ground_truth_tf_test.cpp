#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ground_scale_vo {
namespace {

/// A transform along x at a time [s].
tf2_msgs::TFMessage transform(const std::string& parent, const std::string& child, double time,
                              double x) {
  tf2_msgs::TFMessage message;
  message.transforms.resize(1);
  message.transforms[0].header.frame_id = parent;
  message.transforms[0].header.stamp = ros::Time(time);
  message.transforms[0].child_frame_id = child;
  message.transforms[0].transform.translation.x = x;
  message.transforms[0].transform.rotation.w = 1;
  return message;
}

TEST(GroundTruthTf, FindsTheGroundTruthFrameOfKittiToBag) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("ground_truth", "ground_truth/camera", 1, 5), false);
  const auto pose = ground_truth.pose("camera", ros::Time(1));
  ASSERT_TRUE(pose);
  EXPECT_DOUBLE_EQ(pose->translation().x(), 5);
}

TEST(GroundTruthTf, IsNotThePoseThatTheOdometryBroadcasts) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("odom", "camera", 1, 4), false);
  ground_truth.add(transform("ground_truth", "ground_truth/camera", 1, 5), false);
  const auto pose = ground_truth.pose("/camera", ros::Time(1));
  ASSERT_TRUE(pose);
  EXPECT_DOUBLE_EQ(pose->translation().x(), 5);
}

TEST(GroundTruthTf, FindsTheFrameItselfAsKitti2bagWritesIt) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("/camera_init", "/camera_gray_left", 1, 5), false);
  ground_truth.add(transform("/camera_init", "/camera_gray_left", 2, 6), false);
  EXPECT_DOUBLE_EQ(ground_truth.pose("camera_gray_left", ros::Time(1.5))->translation().x(), 5.5);
  EXPECT_FALSE(ground_truth.pose("camera_gray_left", ros::Time(3)));
  EXPECT_FALSE(ground_truth.pose("camera_color", ros::Time(1)));
}

TEST(GroundTruthTf, KeepsALongDrive) {
  GroundTruthTf ground_truth;
  for (const double time : {1, 2, 100000}) {
    ground_truth.add(transform("camera_init", "camera_gray_left", time, 10 * time), false);
  }
  const auto pose = ground_truth.pose("camera_gray_left", ros::Time(1.5));
  ASSERT_TRUE(pose);
  EXPECT_DOUBLE_EQ(pose->translation().x(), 15);
}

TEST(GroundTruthTf, FindsTheOtherNameThatKitti2bagGivesToTheCamera) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("world", "camera_left", 1, 5), false);
  ASSERT_TRUE(ground_truth.pose("camera_gray_left", ros::Time(1)));
  EXPECT_DOUBLE_EQ(ground_truth.pose("camera_gray_left", ros::Time(1))->translation().x(), 5);
  EXPECT_FALSE(ground_truth.pose("camera_color_left", ros::Time(1)));
}

TEST(GroundTruthTf, ItsWorldMayHaveAStaticParent) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("map", "world", 1, 0.5), true);
  ground_truth.add(transform("world", "camera_left", 1, 5), false);
  ASSERT_TRUE(ground_truth.pose("camera_gray_left", ros::Time(1)));
  EXPECT_DOUBLE_EQ(ground_truth.pose("camera_gray_left", ros::Time(1))->translation().x(), 5.5);
}

TEST(GroundTruthTf, FollowsTheStaticChainThatKitti2bagWritesForKittiRaw) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("base_link", "imu_link", 1, 0.5), true);
  ground_truth.add(transform("imu_link", "camera_gray_left", 1, 0.25), true);
  EXPECT_FALSE(ground_truth.pose("camera_gray_left", ros::Time(1)));  // no moving transform yet
  ground_truth.add(transform("world", "base_link", 1, 5), false);
  EXPECT_DOUBLE_EQ(ground_truth.pose("camera_gray_left", ros::Time(1))->translation().x(), 5.75);
  EXPECT_DOUBLE_EQ(ground_truth.pose("base_link", ros::Time(1))->translation().x(), 5);
  ground_truth.add(transform("world", "base_link", 9, 7), false);  // long after the static ones
  ASSERT_TRUE(ground_truth.pose("camera_gray_left", ros::Time(9)));
  EXPECT_DOUBLE_EQ(ground_truth.pose("camera_gray_left", ros::Time(9))->translation().x(), 7.75);
}

TEST(GroundTruthTf, IgnoresTransformsThatTf2Refuses) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("world", "camera_left", 1, 5), false);
  ground_truth.add(transform("camera_left", "camera_left", 1, 6), false);
  ground_truth.add(transform("other", "camera_left", 1, NAN), false);
  ASSERT_TRUE(ground_truth.pose("camera_gray_left", ros::Time(1)));
  EXPECT_DOUBLE_EQ(ground_truth.pose("camera_gray_left", ros::Time(1))->translation().x(), 5);
}

}  // namespace
}  // namespace ground_scale_vo
