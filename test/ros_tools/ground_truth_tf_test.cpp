#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

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

/// The position along x; NaN if there is no pose.
double positionOf(const GroundTruthTf& ground_truth, const std::string& frame, double time) {
  const auto pose = ground_truth.pose(frame, ros::Time(time));
  return pose ? pose->translation().x() : NAN;
}

TEST(GroundTruthTf, IsOfTheGroundTruthFrameRatherThanOfTheOdometry) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("odom", "camera", 1, 4), false);
  ground_truth.add(transform("ground_truth", "ground_truth/camera", 1, 5), false);
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "camera", 1), 5);
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "/camera", 1), 5);
}

TEST(GroundTruthTf, InterpolatesTheFrameThatKitti2bagWrites) {
  GroundTruthTf ground_truth;
  for (const double time : {1, 2, 100000}) {  // a long drive
    ground_truth.add(transform("/camera_init", "/camera_gray_left", time, 10 * time), false);
  }
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "camera_gray_left", 1.5), 15);
  EXPECT_FALSE(ground_truth.pose("camera_gray_left", ros::Time(100001)));
  EXPECT_FALSE(ground_truth.pose("camera_color", ros::Time(1)));
}

TEST(GroundTruthTf, FindsTheOtherNameThatKitti2bagGivesToTheCamera) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("map", "world", 1, 0.5), true);
  ground_truth.add(transform("world", "camera_left", 1, 5), false);
  // tf2 refuses these.
  ground_truth.add(transform("camera_left", "camera_left", 1, 6), false);
  ground_truth.add(transform("other", "camera_left", 1, NAN), false);
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "camera_gray_left", 1), 5.5);
  EXPECT_FALSE(ground_truth.pose("camera_color_left", ros::Time(1)));
}

TEST(GroundTruthTf, FollowsTheStaticChainThatKitti2bagWritesForKittiRaw) {
  GroundTruthTf ground_truth;
  ground_truth.add(transform("base_link", "imu_link", 1, 0.5), true);
  ground_truth.add(transform("imu_link", "camera_gray_left", 1, 0.25), true);
  EXPECT_FALSE(ground_truth.pose("camera_gray_left", ros::Time(1)));  // no moving transform yet
  ground_truth.add(transform("world", "base_link", 1, 5), false);
  ground_truth.add(transform("world", "base_link", 9, 7), false);  // long after the static ones
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "camera_gray_left", 1), 5.75);
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "camera_gray_left", 9), 7.75);
  EXPECT_DOUBLE_EQ(positionOf(ground_truth, "base_link", 1), 5);
}

}  // namespace
}  // namespace ground_scale_vo
