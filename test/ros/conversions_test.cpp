#include "ground_scale_vo/ros/conversions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/scale/pose_covariance.hpp"

namespace ground_scale_vo {
namespace {

TEST(Nanoseconds, HoldAllStampsExactly) {
  constexpr auto kMaxSeconds = std::numeric_limits<std::uint32_t>::max();
  for (const ros::Time& stamp : {ros::Time(0, 0), ros::Time(0, 1), ros::Time(2147483648u, 5),
                                 ros::Time(kMaxSeconds, 999999999)}) {
    EXPECT_EQ(fromNanoseconds(toNanoseconds(stamp)), stamp);
  }
  EXPECT_EQ(toNanoseconds(ros::Time(kMaxSeconds, 999999999)), 4294967295999999999);
  EXPECT_EQ(toNanoseconds(fromNanoseconds(1317617735123456789)), 1317617735123456789);
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
  frame.camera.width = 1241;
  frame.camera.height = 376;
  frame.camera.fx = 718.856;
  frame.camera.fy = 718.857;
  frame.camera.cx = 607.1928;
  frame.camera.cy = 185.2157;
  frame.T_w_c.linear() =
      Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
          .normalized()
          .toRotationMatrix();
  frame.T_w_c.translation() << normal(random), normal(random), normal(random);
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

std_msgs::Header headerOf(const VoFrame& frame) {
  std_msgs::Header header;
  header.stamp = fromNanoseconds(frame.stamp_ns);
  header.frame_id = "camera";
  return header;
}

TEST(VoFrameMsg, RoundTripIsExact) {
  const VoFrame frame = someFrame();
  const VoFrameMsg::Ptr msg = toMsg(frame, headerOf(frame));
  const VoFrame back = fromMsg(*msg);
  EXPECT_EQ(back.stamp_ns, frame.stamp_ns);
  EXPECT_EQ(back.sequence, frame.sequence);
  EXPECT_EQ(back.status, frame.status);
  EXPECT_EQ(back.map_id, frame.map_id);
  EXPECT_EQ(back.keyframe, frame.keyframe);
  EXPECT_EQ(back.camera.width, frame.camera.width);
  EXPECT_EQ(back.camera.height, frame.camera.height);
  EXPECT_EQ(back.camera.fx, frame.camera.fx);
  EXPECT_EQ(back.camera.fy, frame.camera.fy);
  EXPECT_EQ(back.camera.cx, frame.camera.cx);
  EXPECT_EQ(back.camera.cy, frame.camera.cy);
  EXPECT_EQ(back.T_w_c.translation(), frame.T_w_c.translation());
  EXPECT_LT((back.T_w_c.linear() - frame.T_w_c.linear()).norm(), 1e-15);
  EXPECT_EQ(back.map_start.stamp_ns, frame.map_start.stamp_ns);
  EXPECT_LT((back.map_start.R_previous_w - frame.map_start.R_previous_w).norm(), 1e-15);
  EXPECT_EQ(back.map_start.rotation_sigma, frame.map_start.rotation_sigma);
  ASSERT_EQ(back.features.size(), frame.features.size());
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const TrackedFeature &a = frame.features[i], &b = back.features[i];
    EXPECT_EQ(b.id, a.id);
    EXPECT_EQ(b.age, a.age);
    EXPECT_EQ(b.u, a.u);
    EXPECT_EQ(b.has_point, a.has_point);
    EXPECT_EQ(b.p_c, a.p_c);
    EXPECT_EQ(b.depth_sigma, a.depth_sigma);
  }
}

TEST(VoFrameMsg, RefusesInvalidMessages) {
  const VoFrame frame = someFrame();
  const VoFrameMsg good = *toMsg(frame, headerOf(frame));
  EXPECT_NO_THROW(fromMsg(good));
  VoFrameMsg msg = good;
  msg.z.pop_back();
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.age.pop_back();
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  std::swap(msg.id[3], msg.id[4]);  // ids must increase
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg.id[3] = msg.id[4];
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.u[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg.u[2] = 1e30f;  // beyond the range of int
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.fx = 0;
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.status = 9;
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.pose.orientation = geometry_msgs::Quaternion();
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.pose.position.x = std::numeric_limits<double>::infinity();
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg.pose.position.x = 1e300;
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg.status = VoFrameMsg::LOST;  // the pose is not used then
  EXPECT_NO_THROW(fromMsg(msg));
}

TEST(VoFrameMsg, ARoundedQuaternionIsARotation) {
  const VoFrame frame = someFrame();
  VoFrameMsg msg = *toMsg(frame, headerOf(frame));
  for (auto* q : {&msg.pose.orientation, &msg.map_start_rotation}) {
    for (double* element : {&q->x, &q->y, &q->z, &q->w}) *element *= 1.005;
  }
  const VoFrame back = fromMsg(msg);
  EXPECT_LT((back.T_w_c.linear() - frame.T_w_c.linear()).norm(), 1e-12);
  EXPECT_LT((back.map_start.R_previous_w - frame.map_start.R_previous_w).norm(), 1e-12);
}

TEST(VoFrameMsg, MapStartMayBeUnknown) {
  const VoFrame frame = someFrame();
  const VoFrameMsg good = *toMsg(frame, headerOf(frame));
  VoFrameMsg msg = good;  // an odometry that does not fill the fields
  msg.map_start = ros::Time();
  msg.map_start_rotation = geometry_msgs::Quaternion();
  msg.map_start_rotation_sigma = 0;
  EXPECT_EQ(fromMsg(msg).map_start.stamp_ns, 0);
  EXPECT_FALSE(std::isfinite(fromMsg(msg).map_start.rotation_sigma));
  for (const double unknown :
       {-1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    msg = good;
    msg.map_start_rotation = geometry_msgs::Quaternion();
    msg.map_start_rotation_sigma = unknown;
    EXPECT_EQ(fromMsg(msg).map_start.stamp_ns, frame.map_start.stamp_ns);
    EXPECT_EQ(fromMsg(msg).map_start.R_previous_w, Eigen::Matrix3d::Identity());
    EXPECT_FALSE(std::isfinite(fromMsg(msg).map_start.rotation_sigma));
  }
  msg = good;
  msg.map_start_rotation_sigma = 0;  // known, without an error
  EXPECT_EQ(fromMsg(msg).map_start.rotation_sigma, 0);
  VoFrame unknown = frame;
  unknown.map_start = {};
  EXPECT_EQ(fromMsg(*toMsg(unknown, headerOf(frame))).map_start.stamp_ns, 0);
  msg = good;
  msg.map_start_rotation.w = 3;
  EXPECT_THROW(fromMsg(msg), MessageError);
  msg = good;
  msg.map_start = msg.header.stamp;  // the first frame of the map
  EXPECT_EQ(fromMsg(msg).map_start.stamp_ns, frame.stamp_ns);
  msg.map_start += ros::Duration(1);
  EXPECT_THROW(fromMsg(msg), MessageError);
}

/// The sentence with which a message is refused.
template <typename Message>
std::string reasonOf(const Message& msg) {
  try {
    fromMsg(msg);
  } catch (const MessageError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(VoFrameMsg, TheReasonNamesFieldValueAndLimit) {
  const VoFrame frame = someFrame();
  const VoFrameMsg good = *toMsg(frame, headerOf(frame));
  VoFrameMsg msg = good;
  const auto expectSizeOf = [&good](const std::string& name, auto array) {
    VoFrameMsg shorter = good;
    (shorter.*array).pop_back();
    EXPECT_EQ(reasonOf(shorter), name + " has 49 elements, but id has 50");
  };
  expectSizeOf("age", &VoFrameMsg::age);
  expectSizeOf("u", &VoFrameMsg::u);
  expectSizeOf("v", &VoFrameMsg::v);
  expectSizeOf("x", &VoFrameMsg::x);
  expectSizeOf("y", &VoFrameMsg::y);
  expectSizeOf("z", &VoFrameMsg::z);
  expectSizeOf("depth_sigma", &VoFrameMsg::depth_sigma);
  msg.id[4] = 7;
  EXPECT_EQ(reasonOf(msg), "the ids are not in ascending order: id[4] is 7 after 25769803781");
  msg = good;
  msg.v[2] = 2e9f;
  msg.u[2] = 1;
  EXPECT_EQ(reasonOf(msg),
            "feature 17179869189 has the pixel (1, 2e+09), which is not finite or beyond 1e+09");
  msg = good;
  msg.fx = 0;
  EXPECT_EQ(reasonOf(msg),
            "camera intrinsics or image size of the frame are invalid: camera fx [px] is 0, it "
            "must lie in [1, 1e+06]");
  msg = good;
  msg.status = 9;
  EXPECT_EQ(reasonOf(msg), "status is 9, it must lie in [0, 2]");
  msg = good;
  msg.pose.position.x = -2e9;
  msg.pose.position.y = 1;
  msg.pose.position.z = 0.5;
  EXPECT_EQ(reasonOf(msg),
            "the position (-2e+09, 1, 0.5) of the pose is not finite or beyond 1e+09");
  msg = good;
  msg.pose.orientation = geometry_msgs::Quaternion();
  EXPECT_EQ(reasonOf(msg),
            "the quaternion (0, 0, 0, 0) of the pose is not of unit length: its norm is 0, it "
            "must lie in [0.99, 1.01]");
}

TEST(VoFrameMsg, AFeatureWithoutAPointHasNoNumbersForIt) {
  VoFrame frame = someFrame();
  frame.features[0].has_point = false;
  frame.features[0].p_c = {1, 2, 3};
  frame.features[0].depth_sigma = 1;
  const VoFrameMsg::Ptr msg = toMsg(frame, headerOf(frame));
  for (const auto* array : {&msg->x, &msg->y, &msg->z, &msg->depth_sigma}) {
    EXPECT_TRUE(std::isnan(array->at(0)));
  }
}

TEST(VoFrameMsg, UnusablePointsAreDropped) {
  const VoFrame frame = someFrame();
  VoFrameMsg msg = *toMsg(frame, headerOf(frame));
  msg.z[1] = -2.f;  // behind the camera
  msg.depth_sigma[2] = std::numeric_limits<float>::infinity();
  msg.x[3] = 1e30f;  // implausibly far away
  const VoFrame back = fromMsg(msg);
  EXPECT_FALSE(back.features[1].has_point);
  EXPECT_FALSE(back.features[2].has_point);
  EXPECT_FALSE(back.features[3].has_point);
  EXPECT_TRUE(back.features[4].has_point);
}

TEST(ScaleEstimateMsg, RoundTripIsExact) {
  ScaleEstimate scale;
  scale.status = ScaleStatus::kHeld;
  scale.reason = ScaleReason::kPlaneTilted;
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
  const ScaleEstimate back = fromMsg(*msg);
  EXPECT_EQ(back.status, scale.status);
  EXPECT_EQ(back.reason, scale.reason);
  EXPECT_EQ(back.raw_scale, scale.raw_scale);
  EXPECT_EQ(back.scale, scale.scale);
  EXPECT_EQ(back.sigma, scale.sigma);
  EXPECT_EQ(back.height, scale.height);
  EXPECT_EQ(back.n_c, scale.n_c);
  EXPECT_EQ(back.triangles, scale.triangles);
  EXPECT_EQ(back.ground_triangles, scale.ground_triangles);
  EXPECT_EQ(back.ground_points, scale.ground_points);
  EXPECT_EQ(back.window_points, scale.window_points);
  EXPECT_EQ(back.plane_inliers, scale.plane_inliers);
  EXPECT_EQ(msg->triangles, 5u);
  EXPECT_EQ(msg->window_points, 2u);
}

TEST(Messages, ConstantsAreTheEnumerators) {
  EXPECT_EQ(int{VoFrameMsg::INITIALISING}, static_cast<int>(VoStatus::kInitialising));
  EXPECT_EQ(int{VoFrameMsg::TRACKING}, static_cast<int>(VoStatus::kTracking));
  EXPECT_EQ(int{VoFrameMsg::LOST}, static_cast<int>(VoStatus::kLost));
  using Scale = ScaleEstimateMsg;
  EXPECT_EQ(int{Scale::UNKNOWN}, static_cast<int>(ScaleStatus::kUnknown));
  EXPECT_EQ(int{Scale::OK}, static_cast<int>(ScaleStatus::kOk));
  EXPECT_EQ(int{Scale::HELD}, static_cast<int>(ScaleStatus::kHeld));
  EXPECT_EQ(int{Scale::NONE}, static_cast<int>(ScaleReason::kNone));
  EXPECT_EQ(int{Scale::VO_NOT_TRACKING}, static_cast<int>(ScaleReason::kVoNotTracking));
  EXPECT_EQ(int{Scale::STANDSTILL}, static_cast<int>(ScaleReason::kStandstill));
  EXPECT_EQ(int{Scale::TOO_FEW_TRIANGLES}, static_cast<int>(ScaleReason::kTooFewTriangles));
  EXPECT_EQ(int{Scale::TOO_FEW_GROUND_POINTS}, static_cast<int>(ScaleReason::kTooFewGroundPoints));
  EXPECT_EQ(int{Scale::NO_PLANE}, static_cast<int>(ScaleReason::kNoPlane));
  EXPECT_EQ(int{Scale::PLANE_TILTED}, static_cast<int>(ScaleReason::kPlaneTilted));
  EXPECT_EQ(int{Scale::REJECTED_BY_FILTER}, static_cast<int>(ScaleReason::kRejectedByFilter));
  EXPECT_EQ(int{Scale::IMPLAUSIBLE_MOTION}, static_cast<int>(ScaleReason::kImplausibleMotion));
}

TEST(ScaleEstimateMsg, TheReasonNamesFieldValueAndLimit) {
  ScaleEstimateMsg msg;
  msg.status = 3;
  EXPECT_EQ(reasonOf(msg), "status is 3, it must lie in [0, 2]");
  msg.status = 0;
  msg.reason = 9;
  EXPECT_EQ(reasonOf(msg), "reason is 9, it must lie in [0, 8]");
}

/// axis_angle: rotation vector [rad].
Eigen::Isometry3d isometry(const Eigen::Vector3d& axis_angle, const Eigen::Vector3d& t) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  if (axis_angle.norm() > 0) {
    T.linear() = Eigen::AngleAxisd(axis_angle.norm(), axis_angle.normalized()).toRotationMatrix();
  }
  T.translation() = t;
  return T;
}

using Covariance = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>;

TEST(Odometry, ACameraThatDrivesForwardMovesAlongX) {
  MetricPose pose;
  pose.T_o_c = isometry({0, 0, 0}, {1, -2, 10});  // 1 right, 2 up, 10 forward
  pose.twist_c << 0.1, -0.2, 5, 0, 0.3, 0;        // turns right: about y down
  pose.covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  pose.twist_covariance.setIdentity();
  const auto odometry =
      toOdometryMsg(pose, OdometryFrames::ofCamera("odom", "cam"), ros::Time(3, 4));
  EXPECT_EQ(odometry->header.frame_id, "odom");
  EXPECT_EQ(odometry->child_frame_id, "cam");
  EXPECT_EQ(odometry->header.stamp, ros::Time(3, 4));
  EXPECT_NEAR(odometry->pose.pose.position.x, 10, 1e-12);
  EXPECT_NEAR(odometry->pose.pose.position.y, -1, 1e-12);
  EXPECT_NEAR(odometry->pose.pose.position.z, 2, 1e-12);
  // The child frame is the camera: the orientation is that of an optical frame, and the twist is in
  // camera axes.
  const Eigen::Isometry3d T = fromMsg(odometry->pose.pose);
  EXPECT_TRUE(T.linear().isApprox(bodyFromOptical(), 1e-12));
  EXPECT_NEAR(odometry->twist.twist.linear.z, 5, 1e-12);
  EXPECT_NEAR(odometry->twist.twist.angular.y, 0.3, 1e-12);
  // Covariance in odom axes, which are the camera's z, -x and -y.
  const Covariance covariance(odometry->pose.covariance.data());
  EXPECT_NEAR(covariance(0, 0), 3, 1e-12);
  EXPECT_NEAR(covariance(1, 1), 1, 1e-12);
  EXPECT_NEAR(covariance(2, 2), 2, 1e-12);
  EXPECT_NEAR(covariance(3, 3), 6, 1e-12);
}

TEST(Odometry, UpToScaleHasTheCovarianceOfThePoseAndNoTwist) {
  VoFrame frame;
  frame.camera.width = 640;
  frame.camera.height = 480;
  frame.camera.fx = frame.camera.fy = 500;
  frame.camera.cx = 320;
  frame.camera.cy = 240;
  frame.status = VoStatus::kTracking;
  frame.T_w_c = isometry({0, 0.5, 0}, {1, 2, 3});
  std_msgs::Header header;
  header.frame_id = "camera";
  header.stamp = ros::Time(5, 6);
  // Unknown: too few points.
  const auto unknown = toOdometryMsg(frame, header, "vo_world");
  EXPECT_EQ(unknown->pose.covariance[0], -1);
  EXPECT_EQ(unknown->header.stamp, header.stamp);
  EXPECT_EQ(unknown->header.frame_id, "vo_world");
  EXPECT_EQ(unknown->child_frame_id, "camera");
  for (int i = 0; i < 100; ++i) {
    TrackedFeature feature;
    feature.id = static_cast<std::uint64_t>(i);
    const Eigen::Vector3d p(i % 10 - 4.5, i / 10 - 4.5, 10 + i % 7);
    feature.u = (frame.camera.project(p) + Eigen::Vector2d(i % 3 - 1, i % 2)).cast<float>();
    feature.has_point = true;
    feature.p_c = p.cast<float>();
    feature.depth_sigma = 0.1F;
    frame.features.push_back(feature);
  }
  const auto odometry = toOdometryMsg(frame, header, "vo_world");
  const Covariance covariance(odometry->pose.covariance.data());
  Matrix6d R = Matrix6d::Zero();
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = frame.T_w_c.linear();
  EXPECT_TRUE(covariance.isApprox(R * poseCovariance(frame, 1) * R.transpose(), 1e-9));
  EXPECT_GT(covariance(0, 0), 0);
  EXPECT_EQ(odometry->twist.covariance[0], -1);
}

TEST(Odometry, ABaseStartsAtTheOriginOfOdom) {
  Eigen::Isometry3d T_b_c = Eigen::Isometry3d::Identity();
  T_b_c.linear() = bodyFromOptical();
  T_b_c.translation() << 1.5, 0.2, 1.4;
  const OdometryFrames frames = OdometryFrames::ofBase("odom", "base_link", T_b_c);
  MetricPose pose;
  const auto start = toOdometryMsg(pose, frames, ros::Time(1));
  EXPECT_TRUE(fromMsg(start->pose.pose).isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  pose.T_o_c = isometry({0, 0, 0}, {0, 0, 7});
  EXPECT_NEAR(toOdometryMsg(pose, frames, ros::Time(1))->pose.pose.position.x, 7, 1e-12);
}

TEST(Odometry, CovarianceAgreesWithFiniteDifferences) {
  const Eigen::Isometry3d T_b_c = isometry({0.3, -1.1, 0.4}, {1.5, 0.2, 1.4});
  const OdometryFrames frames = OdometryFrames::ofBase("odom", "base_link", T_b_c);
  MetricPose pose;
  pose.T_o_c = isometry({-0.2, 0.7, 0.1}, {3, -1, 20});
  const Eigen::Isometry3d published = fromMsg(toOdometryMsg(pose, frames, ros::Time(1))->pose.pose);
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 6; ++k) {
    MetricPose disturbed = pose;
    if (k < 3) {
      disturbed.T_o_c.translation()[k] += kStep;
    } else {
      disturbed.T_o_c.linear() =
          isometry(kStep * Eigen::Vector3d::Unit(k - 3), {0, 0, 0}).linear() * pose.T_o_c.linear();
    }
    const Eigen::Isometry3d moved =
        fromMsg(toOdometryMsg(disturbed, frames, ros::Time(1))->pose.pose);
    Eigen::Matrix<double, 6, 1> column;
    column.head<3>() = (moved.translation() - published.translation()) / kStep;
    const Eigen::AngleAxisd rotation(moved.linear() * published.linear().transpose());
    column.tail<3>() = rotation.angle() / kStep * rotation.axis();

    MetricPose certain = pose;
    certain.covariance.setZero();
    certain.covariance(k, k) = 1;
    const auto odometry = toOdometryMsg(certain, frames, ros::Time(1));
    const Covariance covariance(odometry->pose.covariance.data());
    EXPECT_LT((covariance - column * column.transpose()).norm(), 1e-3) << k;
  }
}

/// A covariance without zeros.
Matrix6d someCovariance(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Matrix6d root;
  for (int i = 0; i < root.size(); ++i) root(i) = normal(random);
  return root * root.transpose();
}

TEST(Odometry, CovariancesAreExactlySymmetric) {
  MetricPose pose;
  pose.T_o_c = isometry({-0.2, 0.7, 0.1}, {3, -1, 20});
  pose.covariance = someCovariance(1);
  pose.twist_covariance = someCovariance(2);
  const Eigen::Isometry3d T_b_c = isometry({0.3, -1.1, 0.4}, {1.5, 0.2, 1.4});
  const auto odometry =
      toOdometryMsg(pose, OdometryFrames::ofBase("odom", "base_link", T_b_c), ros::Time(1));
  for (const auto* array : {&odometry->pose.covariance, &odometry->twist.covariance}) {
    const Covariance covariance(array->data());
    EXPECT_EQ(covariance, covariance.transpose());
    EXPECT_GT(covariance.determinant(), 0);
  }
}

TEST(Odometry, TwistCovarianceAgreesWithTheTwist) {
  const Eigen::Isometry3d T_b_c = isometry({0.3, -1.1, 0.4}, {1.5, 0.2, 1.4});
  const OdometryFrames frames = OdometryFrames::ofBase("odom", "base_link", T_b_c);
  for (int k = 0; k < 6; ++k) {
    MetricPose pose;
    pose.T_o_c = isometry({-0.2, 0.7, 0.1}, {3, -1, 20});
    pose.twist_c[k] = 1;
    pose.twist_covariance(k, k) = 1;
    const auto odometry = toOdometryMsg(pose, frames, ros::Time(1));
    const geometry_msgs::Twist& twist = odometry->twist.twist;
    Vector6d column;
    column << twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y,
        twist.angular.z;
    const Covariance covariance(odometry->twist.covariance.data());
    EXPECT_LT((covariance - column * column.transpose()).norm(), 1e-9) << k;
  }
}

TEST(Odometry, ABaseThatStandsStillUnderAMovingCameraHasNoTwist) {
  const Eigen::Isometry3d T_b_c = isometry({0.3, -1.1, 0.4}, {1.5, 0.2, 1.4});
  constexpr double kTime = 0.5;  // the camera turns by 0.2 rad, so its axes matter
  const Eigen::Isometry3d moved = isometry({0, 0, 0.4 * kTime}, {0.1 * kTime, 0, 0}) * T_b_c;
  OdometryFrames frames = OdometryFrames::ofBase("odom", "base_link", T_b_c);
  MetricPose pose;  // of the camera in its first frame
  pose.T_o_c = T_b_c.inverse() * moved;
  pose.twist_c << pose.T_o_c.linear().transpose() * pose.T_o_c.translation() / kTime,
      rotationVector(pose.T_o_c.linear()) / kTime;
  frames.moveMounting(moved, kTime);
  const auto odometry = toOdometryMsg(pose, frames, ros::Time(1));
  EXPECT_TRUE(fromMsg(odometry->pose.pose).isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  const geometry_msgs::Twist& twist = odometry->twist.twist;
  EXPECT_NEAR(std::hypot(twist.linear.x, twist.linear.y, twist.linear.z), 0, 1e-9);
  EXPECT_NEAR(std::hypot(twist.angular.x, twist.angular.y, twist.angular.z), 0, 1e-9);
  frames.moveMounting(T_b_c, 0);  // the interval is not known
  EXPECT_EQ(frames.mounting_twist_c, Vector6d::Zero());
}

TEST(Odometry, TheTransformIsThePose) {
  MetricPose pose;
  pose.T_o_c = isometry({-0.2, 0.7, 0.1}, {3, -1, 20});
  const auto odometry =
      toOdometryMsg(pose, OdometryFrames::ofCamera("odom", "cam"), ros::Time(3, 4));
  const geometry_msgs::TransformStamped transform = toTransformMsg(*odometry);
  EXPECT_EQ(transform.header.stamp, ros::Time(3, 4));
  EXPECT_EQ(transform.header.frame_id, "odom");
  EXPECT_EQ(transform.child_frame_id, "cam");
  EXPECT_TRUE(fromMsg(transform.transform).isApprox(fromMsg(odometry->pose.pose), 1e-12));
}

TEST(PoseOrigin, MovesToTheFirstPoseAfterAReset) {
  PoseOrigin origin;
  MetricPose first, second;
  first.T_o_c = isometry({-0.2, 0.7, 0.1}, {3, -1, 20});
  second.T_o_c = first.T_o_c * isometry({0, 0.1, 0}, {0, 0, 2});
  second.covariance = someCovariance(3);
  EXPECT_TRUE(origin.relative(first).T_o_c.isApprox(first.T_o_c));
  origin.moveToNextPose();
  EXPECT_EQ(origin.relative(first).T_o_c.matrix(), Eigen::Matrix4d::Identity());
  const MetricPose moved = origin.relative(second);
  EXPECT_TRUE(moved.T_o_c.isApprox(isometry({0, 0.1, 0}, {0, 0, 2}), 1e-12));
  Matrix6d R = Matrix6d::Zero();  // from o axes to those of the origin
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = first.T_o_c.linear().transpose();
  EXPECT_TRUE(moved.covariance.isApprox(R * second.covariance * R.transpose(), 1e-12));
  origin.clear();
  EXPECT_TRUE(origin.relative(second).T_o_c.isApprox(second.T_o_c));
  origin.moveToNextPose();
  origin.clear();  // before a pose
  EXPECT_TRUE(origin.relative(second).T_o_c.isApprox(second.T_o_c));
}

// The twist of the base must agree with the displacement of the base over a short time.
TEST(Odometry, TwistIsThatOfTheBase) {
  const Eigen::Isometry3d T_b_c = isometry({0.3, -1.1, 0.4}, {1.5, 0.2, 1.4});
  MetricPose pose;
  pose.T_o_c = isometry({-0.2, 0.7, 0.1}, {3, -1, 20});
  pose.twist_c << 0.1, -0.2, 8, 0.05, -0.3, 0.02;
  constexpr double kTime = 1e-6;
  const Eigen::Isometry3d T_c_then =
      isometry(kTime * pose.twist_c.tail<3>(), kTime * pose.twist_c.head<3>());
  const Eigen::Isometry3d T_b_then = T_b_c * T_c_then * T_b_c.inverse();
  const Eigen::AngleAxisd rotation(T_b_then.linear());
  const Eigen::Vector3d v = T_b_then.translation() / kTime;
  const Eigen::Vector3d w = rotation.angle() / kTime * rotation.axis();
  const auto odometry =
      toOdometryMsg(pose, OdometryFrames::ofBase("odom", "base_link", T_b_c), ros::Time(1));
  EXPECT_NEAR(odometry->twist.twist.linear.x, v.x(), 1e-4);
  EXPECT_NEAR(odometry->twist.twist.linear.y, v.y(), 1e-4);
  EXPECT_NEAR(odometry->twist.twist.linear.z, v.z(), 1e-4);
  EXPECT_NEAR(odometry->twist.twist.angular.x, w.x(), 1e-4);
  EXPECT_NEAR(odometry->twist.twist.angular.y, w.y(), 1e-4);
  EXPECT_NEAR(odometry->twist.twist.angular.z, w.z(), 1e-4);
}

}  // namespace
}  // namespace ground_scale_vo
