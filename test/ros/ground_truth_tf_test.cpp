#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace gsv {
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

}  // namespace
}  // namespace gsv
