#include "ros/odometry_output.hpp"

#include <chrono>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ros/ros_messages.hpp"
#include "support/scene.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>;

Vector6d vectorOf(const geometry_msgs::Twist& twist) {
  Vector6d vector;
  vector << twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y,
      twist.angular.z;
  return vector;
}

/// A covariance without zeros.
Matrix6d someCovariance() {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Matrix6d root = Matrix6d::NullaryExpr([&] { return normal(random); });
  return root * root.transpose();
}

TEST(CameraOdometry, ACameraThatDrivesForwardMovesAlongX) {
  MetricPose pose;
  pose.T_o_c = test::pose({0, 0, 0}, {1, -2, 10});  // 1 right, 2 up, 10 forward
  pose.twist_c << 0.1, -0.2, 5, 0, 0.3, 0;          // turns right: about y down
  pose.covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  const auto odometry = toOdometryMsg(pose, TfFrames::ofCamera("odom", "cam"), ros::Time(3, 4));
  EXPECT_EQ(odometry->header.frame_id, "odom");
  EXPECT_EQ(odometry->child_frame_id, "cam");
  EXPECT_EQ(odometry->header.stamp, ros::Time(3, 4));
  // The child frame is the camera: the orientation is that of an optical frame, and the twist is in
  // camera axes.
  const Eigen::Isometry3d T = fromMsg(odometry->pose.pose);
  EXPECT_TRUE(T.translation().isApprox(Eigen::Vector3d(10, -1, 2), 1e-12));
  EXPECT_TRUE(T.linear().isApprox(bodyFromOptical(), 1e-12));
  EXPECT_TRUE(vectorOf(odometry->twist.twist).isApprox(pose.twist_c, 1e-12));
  // Covariance in odom axes, which are the camera's z, -x and -y.
  const Covariance covariance(odometry->pose.covariance.data());
  Vector6d expected;
  expected << 3, 1, 2, 6, 4, 5;
  EXPECT_TRUE(covariance.diagonal().isApprox(expected, 1e-12)) << covariance.diagonal();

  const geometry_msgs::TransformStamped transform = toTransformMsg(*odometry);
  EXPECT_EQ(transform.header.stamp, ros::Time(3, 4));
  EXPECT_EQ(transform.header.frame_id, "odom");
  EXPECT_EQ(transform.child_frame_id, "cam");
  EXPECT_TRUE(fromMsg(transform.transform).isApprox(T, 1e-12));
}

TEST(CameraOdometry, UpToScaleHasTheCovarianceOfThePoseAndNoTwist) {
  VoFrame frame;
  frame.camera = test::kCamera;
  frame.status = VoStatus::kTracking;
  frame.T_w_c = test::pose({0, 0.5, 0}, {1, 2, 3});
  const std_msgs::Header header = headerAt(ros::Time(5, 6));
  const auto unknown = toOdometryMsg(frame, header, "vo_world");
  EXPECT_EQ(unknown->pose.covariance[0], -1);
  EXPECT_EQ(unknown->header.frame_id, "vo_world");
  EXPECT_EQ(unknown->child_frame_id, "camera");
  frame.pose_covariance.diagonal() << 1, 4, 9, 1e-2, 4e-2, 9e-2;
  frame.pose_covariance(0, 4) = frame.pose_covariance(4, 0) = 0.05;
  const auto odometry = toOdometryMsg(frame, header, "vo_world");
  const Covariance covariance(odometry->pose.covariance.data());
  Matrix6d R = Matrix6d::Zero();
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = frame.T_w_c.linear();
  EXPECT_TRUE(covariance.isApprox(R * frame.pose_covariance * R.transpose(), 1e-9));
  EXPECT_GT(covariance(0, 0), 0);
  EXPECT_EQ(odometry->twist.covariance[0], -1);
}

class BaseOdometry : public ::testing::Test {
 protected:
  nav_msgs::Odometry message(const MetricPose& pose) const {
    return *toOdometryMsg(pose, frames_, ros::Time(1));
  }

  const Eigen::Isometry3d T_b_c_ = test::pose({0.3, -1.1, 0.4}, {1.5, 0.2, 1.4});
  TfFrames frames_ = TfFrames::ofBase("odom", "base_link", T_b_c_);
  const Eigen::Isometry3d T_o_c_ = test::pose({-0.2, 0.7, 0.1}, {3, -1, 20});
};

/// The motion of the base, in its axes or in those of odom, per step.
Vector6d motionPerStep(const Eigen::Isometry3d& motion, double step) {
  Vector6d vector;
  vector << motion.translation() / step, rotationVector(motion.linear()) / step;
  return vector;
}

TEST_F(BaseOdometry, CovarianceAgreesWithFiniteDifferences) {
  MetricPose pose;
  pose.T_o_c = T_o_c_;
  const Eigen::Isometry3d published = fromMsg(message(pose).pose.pose);
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 6; ++k) {
    MetricPose disturbed = pose;
    const Vector6d step = kStep * Vector6d::Unit(k);
    disturbed.T_o_c.translation() += step.head<3>();
    disturbed.T_o_c.linear() = test::pose(step.tail<3>(), {0, 0, 0}).linear() * T_o_c_.linear();
    const Eigen::Isometry3d moved = fromMsg(message(disturbed).pose.pose);
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    motion.linear() = moved.linear() * published.linear().transpose();
    motion.translation() = moved.translation() - published.translation();
    const Vector6d column = motionPerStep(motion, kStep);

    pose.covariance.setZero();
    pose.covariance(k, k) = 1;
    const nav_msgs::Odometry odometry = message(pose);
    const Covariance covariance(odometry.pose.covariance.data());
    EXPECT_LT((covariance - column * column.transpose()).norm(), 1e-3) << k;
  }
  pose.covariance = someCovariance();
  const nav_msgs::Odometry odometry = message(pose);
  const Covariance covariance(odometry.pose.covariance.data());
  EXPECT_EQ(covariance, covariance.transpose()) << "exactly";
}

// The twist of the base must agree with the displacement of the base over a short time.
TEST_F(BaseOdometry, TwistAndItsCovarianceAreThoseOfTheBase) {
  constexpr double kTime = 1e-6;
  for (int k = 0; k < 6; ++k) {
    MetricPose pose;
    pose.T_o_c = T_o_c_;
    pose.twist_c[k] = 2;
    pose.twist_covariance(k, k) = 4;
    const Eigen::Isometry3d T_c_then =
        test::pose(kTime * pose.twist_c.tail<3>(), kTime * pose.twist_c.head<3>());
    const Vector6d expected = motionPerStep(T_b_c_ * T_c_then * T_b_c_.inverse(), kTime);
    const nav_msgs::Odometry odometry = message(pose);
    const Vector6d twist = vectorOf(odometry.twist.twist);
    EXPECT_LT((twist - expected).norm(), 1e-4) << k;
    const Covariance covariance(odometry.twist.covariance.data());
    EXPECT_LT((covariance - twist * twist.transpose()).norm(), 1e-9) << k;
  }
}

TEST_F(BaseOdometry, ABaseThatStandsStillUnderAMovingCameraHasNoTwist) {
  constexpr double kTime = 0.5;  // the camera turns by 0.2 rad, so its axes matter
  const Eigen::Isometry3d moved = test::pose({0, 0, 0.4 * kTime}, {0.1 * kTime, 0, 0}) * T_b_c_;
  MetricPose pose;  // of the camera in its first frame
  pose.T_o_c = T_b_c_.inverse() * moved;
  pose.twist_c = meanTwist(pose.T_o_c, kTime);
  frames_.moveMounting(moved, kTime);
  const nav_msgs::Odometry odometry = message(pose);
  EXPECT_TRUE(fromMsg(odometry.pose.pose).isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  EXPECT_LT(vectorOf(odometry.twist.twist).norm(), 1e-9);
  frames_.moveMounting(T_b_c_, 0);  // the interval is not known
  EXPECT_EQ(frames_.mounting_twist_c, Vector6d::Zero());
}

nav_msgs::Odometry poseAt(double x, double y = 0, double z = 0) {
  nav_msgs::Odometry pose;
  pose.pose.pose.position.x = x;
  pose.pose.pose.position.y = y;
  pose.pose.pose.position.z = z;
  return pose;
}

TEST(BoundedPath, StaysBoundedAndCoversTheWholeDrive) {
  for (const double spacing : {0.5, 0.0}) {
    BoundedPath path(100, spacing);
    for (int i = 0; i < 100000; ++i) path.add(poseAt(0.1 * i));
    const auto& poses = path.message().poses;
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

tf2_msgs::TFMessage transform(const std::string& parent, const std::string& child) {
  return tfMessage(transformBetween(parent, child, Eigen::Isometry3d::Identity()), ros::Time());
}

FrameParents::Clock::time_point at(double seconds) {
  return FrameParents::Clock::time_point(
      std::chrono::milliseconds(static_cast<int>(1000 * seconds)));
}

TEST(FrameParents, ForgetsAParentThatIsNotBroadcastAnyMore) {
  FrameParents parents;
  for (const int second : {0, 4, 8}) parents.add(transform("w", "camera"), false, at(second));
  EXPECT_EQ(parents.parentOf("camera", at(12.9)), "w");
  EXPECT_EQ(parents.parentOf("camera", at(13.1)), "");
  // It does not hide one that is.
  for (const char* parent : {"a", "z"}) parents.add(transform(parent, "camera"), false, at(8));
  parents.add(transform("mast", "camera"), false, at(20));
  EXPECT_EQ(parents.parentOf("camera", at(20)), "mast");
}

// A filter beside publish_tf.
TEST(FrameParents, KnowsASecondBroadcasterOfTheSameTransform) {
  FrameParents parents;
  parents.add(transform("odom", "base_link"), false, at(0), "odom");  // the node's own
  EXPECT_EQ(parents.parentOf("base_link", at(0)), "");
  parents.add(transform("map", "base_link"), false, at(0), "odom");
  EXPECT_EQ(parents.parentOf("base_link", at(0)), "map") << "of another nodelet of this node";
  parents.add(transform("odom", "base_link"), false, at(10));
  EXPECT_EQ(parents.parentOf("base_link", at(10)), "odom");
}

}  // namespace
}  // namespace gsv
