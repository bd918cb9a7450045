#include "ground_scale_vo/ros_tools/ground_truth_tf.hpp"

#include "ros/ros_messages.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

/// A transform along x at a time [s].
tf2_msgs::TFMessage transform(const std::string& parent, const std::string& child, double time,
                              double x) {
  const Eigen::Isometry3d T_parent_child(Eigen::Translation3d(x, 0, 0));
  return tfMessage(transformBetween(parent, child, T_parent_child), ros::Time(time));
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
