#include "ground_scale_vo/ros/conversions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <tuple>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "support/expect_throws.hpp"
#include "support/scene.hpp"

namespace ground_scale_vo {
namespace {

constexpr float kNanF = std::numeric_limits<float>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Nanoseconds, HoldAllStampsExactly) {
  constexpr auto kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  for (const ros::Time& stamp : {ros::Time(0, 0), ros::Time(0, 1), ros::Time(2147483648u, 5),
                                 ros::Time(kMaxSeconds, 999999999)}) {
    EXPECT_EQ(fromNanoseconds(toNanoseconds(stamp)), stamp);
  }
  EXPECT_EQ(toNanoseconds(ros::Time(kMaxSeconds, 999999999)), 4294967295999999999);
}

/// A frame with random values that need the full precision of their types.
VoFrame someFrame() {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  VoFrame frame;
  frame.stamp_ns = 1317617735123456789;
  frame.sequence = 17;
  frame.status = VoStatus::kTracking;
  frame.map_id = 3;
  frame.keyframe = true;
  frame.camera = {1241, 376, 718.856, 718.857, 607.1928, 185.2157};
  frame.T_w_c = test::pose({0.3, -1.2, 2}, {normal(random), normal(random), normal(random)});
  const Matrix6d root = Matrix6d::NullaryExpr([&] { return normal(random); });
  frame.pose_covariance = root * root.transpose();
  frame.readout_motion << 0.001, 0.02, -0.003, 0.1, -0.01, 1 / 3.0;
  frame.map_start.stamp_ns = 1317617734123456789;
  frame.map_start.R_previous_w = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()).matrix();
  frame.map_start.rotation_sigma = 0.002;
  for (std::uint64_t id = 0; id < 50; ++id) {
    TrackedFeature feature;
    feature.id = (id << 33) + 5;
    feature.age = static_cast<std::uint32_t>(id);
    feature.u = Eigen::Vector2d(normal(random), normal(random)).cast<float>();
    feature.has_point = id % 3 != 0;
    if (feature.has_point) {
      feature.p_c = Eigen::Vector3d(normal(random), normal(random), 2 + 1 / 3.0).cast<float>();
      feature.depth_sigma = 1.f / 3.f;
    }
    frame.features.push_back(feature);
  }
  return frame;
}

VoFrameMsg message(const VoFrame& frame) {
  std_msgs::Header header;
  header.stamp = fromNanoseconds(frame.stamp_ns);
  header.frame_id = "camera";
  return *toMsg(frame, header);
}

TEST(VoFrameMsg, RoundTripIsExact) {
  const VoFrame frame = someFrame();
  const VoFrameMsg msg = message(frame);
  const VoFrame back = fromMsg(msg);
  const auto values = [](const VoFrame& f) {
    return std::tuple(f.stamp_ns, f.sequence, f.status, f.map_id, f.keyframe, f.camera.width,
                      f.camera.height, f.camera.fx, f.camera.fy, f.camera.cx, f.camera.cy,
                      f.map_start.stamp_ns, f.map_start.rotation_sigma, f.features.size());
  };
  EXPECT_EQ(values(back), values(frame));
  EXPECT_EQ(back.T_w_c.translation(), frame.T_w_c.translation());
  EXPECT_LT((back.T_w_c.linear() - frame.T_w_c.linear()).norm(), 1e-15);
  EXPECT_EQ(back.pose_covariance, frame.pose_covariance);
  EXPECT_EQ(back.readout_motion, frame.readout_motion);
  EXPECT_LT((back.map_start.R_previous_w - frame.map_start.R_previous_w).norm(), 1e-15);
  for (std::size_t i = 0; i < back.features.size(); ++i) {
    const TrackedFeature &a = frame.features[i], &b = back.features[i];
    EXPECT_EQ(std::tuple(b.id, b.age, b.has_point), std::tuple(a.id, a.age, a.has_point));
    EXPECT_TRUE(b.u == a.u && b.p_c == a.p_c && b.depth_sigma == a.depth_sigma);
    EXPECT_EQ(std::isnan(msg.x[i]) && std::isnan(msg.depth_sigma[i]), !a.has_point);
  }
}

TEST(VoFrameMsg, RefusesInvalidMessagesAndNamesFieldAndLimit) {
  const struct {
    std::function<void(VoFrameMsg*)> change;
    const char* reason;
  } kCases[] = {
      {[](VoFrameMsg* m) { m->age.pop_back(); }, "age has 49 elements, but id has 50"},
      {[](VoFrameMsg* m) { m->x.pop_back(); }, "x has 49 elements"},
      {[](VoFrameMsg* m) { m->depth_sigma.pop_back(); }, "depth_sigma has 49 elements"},
      {[](VoFrameMsg* m) { m->id[4] = m->id[3]; }, "the ids are not in ascending order"},
      {[](VoFrameMsg* m) { m->u[2] = kNanF; }, "pixel (nan, "},
      {[](VoFrameMsg* m) { m->v[2] = 2e9f; }, "2e+09), which is not finite or beyond 1e+09"},
      {[](VoFrameMsg* m) { m->fx = 0; }, "camera fx [px] is 0"},
      {[](VoFrameMsg* m) { m->status = 3; }, "status is 3, it must lie in [0, 2]"},
      {[](VoFrameMsg* m) { m->pose.position.x = kInfinity; }, "the position (inf, "},
      {[](VoFrameMsg* m) { m->pose.orientation = geometry_msgs::Quaternion(); },
       "the quaternion (0, 0, 0, 0) of the pose is not of unit length"},
      {[](VoFrameMsg* m) { m->pose_covariance[7] = -1; }, "pose_covariance"},
      {[](VoFrameMsg* m) { m->pose_covariance[1] += 1; }, "pose_covariance"},
      {[](VoFrameMsg* m) { m->readout_motion[5] = kInfinity; }, "readout_motion"},
      {[](VoFrameMsg* m) { m->map_start_rotation.w = 3; }, "of map_start_rotation"},
      {[](VoFrameMsg* m) { m->map_start = m->header.stamp + ros::Duration(1); }, "map_start is"},
  };
  const VoFrameMsg good = message(someFrame());
  EXPECT_NO_THROW(fromMsg(good));
  for (const auto& refused : kCases) {
    VoFrameMsg msg = good;
    refused.change(&msg);
    expectThrows<MessageError>([&] { fromMsg(msg); }, refused.reason);
  }
  VoFrameMsg lost = good;
  lost.status = VoFrameMsg::LOST;  // the pose is not used then
  lost.pose.position.x = lost.readout_motion[5] = 1e300;
  EXPECT_NO_THROW(fromMsg(lost));
}

TEST(VoFrameMsg, RoundsQuaternionsAndDropsUnusablePointsAndUnknownCovariances) {
  const VoFrame frame = someFrame();
  VoFrameMsg msg = message(frame);
  for (auto* q : {&msg.pose.orientation, &msg.map_start_rotation}) {
    for (double* element : {&q->x, &q->y, &q->z, &q->w}) *element *= 1.005;
  }
  for (const double unknown : {0.0, -1.0}) {
    msg.pose_covariance[0] = unknown;
    EXPECT_EQ(fromMsg(msg).pose_covariance, Matrix6d::Zero());
  }
  msg.z[1] = -2.f;  // behind the camera
  msg.depth_sigma[2] = std::numeric_limits<float>::infinity();
  msg.x[4] = 1e30f;  // implausibly far away
  const VoFrame back = fromMsg(msg);
  EXPECT_LT((back.T_w_c.linear() - frame.T_w_c.linear()).norm(), 1e-12);
  EXPECT_LT((back.map_start.R_previous_w - frame.map_start.R_previous_w).norm(), 1e-12);
  for (const std::size_t i : {1, 2, 4}) EXPECT_FALSE(back.features[i].has_point) << i;
  EXPECT_TRUE(back.features[5].has_point);
}

TEST(VoFrameMsg, MapStartMayBeUnknown) {
  const VoFrame frame = someFrame();
  const VoFrameMsg good = message(frame);
  VoFrameMsg msg = good;  // an odometry that does not fill the fields
  msg.map_start = ros::Time();
  msg.map_start_rotation = geometry_msgs::Quaternion();
  msg.map_start_rotation_sigma = 0;
  EXPECT_EQ(fromMsg(msg).map_start.stamp_ns, 0);
  EXPECT_FALSE(std::isfinite(fromMsg(msg).map_start.rotation_sigma));
  for (const double unknown : {-1.0, std::nan(""), kInfinity}) {
    msg.map_start = good.header.stamp;  // also of the first frame of the map
    msg.map_start_rotation_sigma = unknown;
    EXPECT_EQ(fromMsg(msg).map_start.stamp_ns, frame.stamp_ns);
    EXPECT_EQ(fromMsg(msg).map_start.R_previous_w, Eigen::Matrix3d::Identity());
    EXPECT_FALSE(std::isfinite(fromMsg(msg).map_start.rotation_sigma));
  }
  msg = good;
  msg.map_start_rotation_sigma = 0;  // known, without an error
  EXPECT_EQ(fromMsg(msg).map_start.rotation_sigma, 0);
}

TEST(ScaleEstimateMsg, RoundTripIsExact) {
  ScaleEstimate scale;
  scale.status = ScaleStatus::kHeld;
  scale.measurement = MeasurementStatus::kPlaneTilted;
  scale.raw_scale = 1 / 3.0;
  scale.scale = 2 / 3.0;
  scale.sigma = 0.1;
  scale.height = 2.5;
  scale.n_c = {0.1, -0.9, -0.2};
  scale.triangles = 5;
  scale.ground_triangles = 4;
  scale.ground_points = 3;
  scale.window_points = 2;
  scale.plane_inliers = 1;
  const ScaleEstimateMsg::Ptr msg = toMsg(scale, 8, std_msgs::Header());
  EXPECT_EQ(msg->map_id, 8u);
  const auto values = [](const ScaleEstimate& s) {
    return std::tuple(s.status, s.measurement, s.raw_scale, s.scale, s.sigma, s.height, s.triangles,
                      s.ground_triangles, s.ground_points, s.window_points, s.plane_inliers);
  };
  EXPECT_EQ(values(fromMsg(*msg)), values(scale));
  EXPECT_EQ(fromMsg(*msg).n_c, scale.n_c);
  msg->reason = 9;
  expectThrows<MessageError>([&] { fromMsg(*msg); }, "reason is 9, it must lie in [0, 8]");
  msg->status = 3;
  expectThrows<MessageError>([&] { fromMsg(*msg); }, "status is 3, it must lie in [0, 2]");
}

TEST(Messages, ConstantsAreTheEnumerators) {
  EXPECT_EQ(int{VoFrameMsg::INITIALISING}, static_cast<int>(VoStatus::kInitialising));
  EXPECT_EQ(int{VoFrameMsg::TRACKING}, static_cast<int>(VoStatus::kTracking));
  EXPECT_EQ(int{VoFrameMsg::LOST}, static_cast<int>(VoStatus::kLost));
  using Scale = ScaleEstimateMsg;
  EXPECT_EQ(int{Scale::UNKNOWN}, static_cast<int>(ScaleStatus::kUnknown));
  EXPECT_EQ(int{Scale::OK}, static_cast<int>(ScaleStatus::kOk));
  EXPECT_EQ(int{Scale::HELD}, static_cast<int>(ScaleStatus::kHeld));
  EXPECT_EQ(int{Scale::NONE}, static_cast<int>(MeasurementStatus::kMeasured));
  EXPECT_EQ(int{Scale::VO_NOT_TRACKING}, static_cast<int>(MeasurementStatus::kVoNotTracking));
  EXPECT_EQ(int{Scale::STANDSTILL}, static_cast<int>(MeasurementStatus::kStandstill));
  EXPECT_EQ(int{Scale::TOO_FEW_TRIANGLES}, static_cast<int>(MeasurementStatus::kTooFewTriangles));
  EXPECT_EQ(int{Scale::TOO_FEW_GROUND_POINTS},
            static_cast<int>(MeasurementStatus::kTooFewGroundPoints));
  EXPECT_EQ(int{Scale::NO_PLANE}, static_cast<int>(MeasurementStatus::kNoPlane));
  EXPECT_EQ(int{Scale::PLANE_TILTED}, static_cast<int>(MeasurementStatus::kPlaneTilted));
  EXPECT_EQ(int{Scale::REJECTED_BY_FILTER}, static_cast<int>(MeasurementStatus::kRejectedByFilter));
  EXPECT_EQ(int{Scale::IMPLAUSIBLE_MOTION},
            static_cast<int>(MeasurementStatus::kImplausibleMotion));
}

using Covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>;

Vector6d vectorOf(const geometry_msgs::Twist& twist) {
  Vector6d vector;
  vector << twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y,
      twist.angular.z;
  return vector;
}

/// blkdiag(R, R)
Matrix6d blockRotation(const Eigen::Matrix3d& R) {
  Matrix6d blocks = Matrix6d::Zero();
  blocks.topLeftCorner<3, 3>() = blocks.bottomRightCorner<3, 3>() = R;
  return blocks;
}

/// A covariance without zeros.
Matrix6d someCovariance(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Matrix6d root;
  for (int i = 0; i < root.size(); ++i) root(i) = normal(random);
  return root * root.transpose();
}

TEST(CameraOdometry, ACameraThatDrivesForwardMovesAlongX) {
  MetricPose pose;
  pose.T_o_c = test::pose({0, 0, 0}, {1, -2, 10});  // 1 right, 2 up, 10 forward
  pose.twist_c << 0.1, -0.2, 5, 0, 0.3, 0;          // turns right: about y down
  pose.covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  const auto odometry =
      toOdometryMsg(pose, OdometryFrames::ofCamera("odom", "cam"), ros::Time(3, 4));
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
  std_msgs::Header header;
  header.frame_id = "camera";
  header.stamp = ros::Time(5, 6);
  const auto unknown = toOdometryMsg(frame, header, "vo_world");
  EXPECT_EQ(unknown->pose.covariance[0], -1);
  EXPECT_EQ(unknown->header.frame_id, "vo_world");
  EXPECT_EQ(unknown->child_frame_id, "camera");
  frame.pose_covariance.diagonal() << 1, 4, 9, 1e-2, 4e-2, 9e-2;
  frame.pose_covariance(0, 4) = frame.pose_covariance(4, 0) = 0.05;
  const auto odometry = toOdometryMsg(frame, header, "vo_world");
  const Covariance covariance(odometry->pose.covariance.data());
  const Matrix6d R = blockRotation(frame.T_w_c.linear());
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
  OdometryFrames frames_ = OdometryFrames::ofBase("odom", "base_link", T_b_c_);
  const Eigen::Isometry3d T_o_c_ = test::pose({-0.2, 0.7, 0.1}, {3, -1, 20});
};

TEST_F(BaseOdometry, StartsAtTheOriginAndDrivesAlongX) {
  Eigen::Isometry3d T_b_c = test::pose({0, 0, 0}, {1.5, 0.2, 1.4});
  T_b_c.linear() = bodyFromOptical();
  frames_ = OdometryFrames::ofBase("odom", "base_link", T_b_c);
  MetricPose pose;
  EXPECT_TRUE(fromMsg(message(pose).pose.pose).isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  pose.T_o_c.translation().z() = 7;
  EXPECT_TRUE(fromMsg(message(pose).pose.pose).isApprox(test::pose({0, 0, 0}, {7, 0, 0}), 1e-12));
}

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
  pose.covariance = someCovariance(1);
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
  pose.twist_c << pose.T_o_c.linear().transpose() * pose.T_o_c.translation() / kTime,
      rotationVector(pose.T_o_c.linear()) / kTime;
  frames_.moveMounting(moved, kTime);
  const nav_msgs::Odometry odometry = message(pose);
  EXPECT_TRUE(fromMsg(odometry.pose.pose).isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  EXPECT_LT(vectorOf(odometry.twist.twist).norm(), 1e-9);
  frames_.moveMounting(T_b_c_, 0);  // the interval is not known
  EXPECT_EQ(frames_.mounting_twist_c, Vector6d::Zero());
}

TEST(PoseOrigin, MovesToTheFirstPoseAfterAReset) {
  const Eigen::Isometry3d step = test::pose({0, 0.1, 0}, {0, 0, 2});
  PoseOrigin origin;
  MetricPose first, second;
  first.T_o_c = test::pose({-0.2, 0.7, 0.1}, {3, -1, 20});
  second.T_o_c = first.T_o_c * step;
  second.covariance = someCovariance(3);
  EXPECT_TRUE(origin.relative(first).T_o_c.isApprox(first.T_o_c));
  origin.moveToNextPose();
  EXPECT_EQ(origin.relative(first).T_o_c.matrix(), Eigen::Matrix4d::Identity());
  const MetricPose moved = origin.relative(second);
  EXPECT_TRUE(moved.T_o_c.isApprox(step, 1e-12));
  const Matrix6d R = blockRotation(first.T_o_c.linear().transpose());
  EXPECT_TRUE(moved.covariance.isApprox(R * second.covariance * R.transpose(), 1e-12));
  origin.clear();
  EXPECT_TRUE(origin.relative(second).T_o_c.isApprox(second.T_o_c));
}

}  // namespace
}  // namespace ground_scale_vo
