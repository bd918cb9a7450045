#include "ground_scale_vo/ros/odometry_message.hpp"

#include <tf2_eigen/tf2_eigen.h>

#include <boost/make_shared.hpp>
#include <utility>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {
namespace {

/// First element of a covariance without an estimate, as sensor_msgs/Imu defines it; nav_msgs and
/// geometry_msgs define none.
constexpr double kUnknown = -1;

/// Transforms a twist or small motion (linear, angular) of a rigid body to other axes, rotated by
/// R, and to another point of the body, at `lever` from the old one in the old axes: v' = R (v + w
/// x lever), w' = R w.
Matrix6d twistTransform(const Eigen::Matrix3d& R, const Eigen::Vector3d& lever) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = R;
  J.topRightCorner<3, 3>() = -R * skew(lever);
  J.bottomRightCorner<3, 3>() = R;
  return J;
}

/// array = J C J', made exactly symmetric.
template <typename Array>
void setCovariance(const Matrix6d& J, const Matrix6d& covariance, Array& array) {
  const Matrix6d propagated = J * covariance * J.transpose();
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(array.data()) =
      0.5 * (propagated + propagated.transpose());
}

}  // namespace

nav_msgs::Odometry::Ptr toOdometryMsg(const VoFrame& frame, const std_msgs::Header& image_header,
                                      const std::string& world_frame) {
  auto msg = boost::make_shared<nav_msgs::Odometry>();
  msg->header.stamp = image_header.stamp;
  msg->header.frame_id = world_frame;
  msg->child_frame_id = image_header.frame_id;
  msg->pose.pose = tf2::toMsg(frame.T_w_c);
  if (frame.pose_covariance.isZero(0)) {
    msg->pose.covariance[0] = kUnknown;
  } else {
    setCovariance(twistTransform(frame.T_w_c.linear(), Eigen::Vector3d::Zero()),
                  frame.pose_covariance, msg->pose.covariance);
  }
  msg->twist.covariance[0] = kUnknown;
  return msg;
}

Eigen::Matrix3d bodyFromOptical() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return R;
}

OdometryFrames OdometryFrames::ofCamera(const std::string& odom_frame,
                                        const std::string& camera_frame) {
  OdometryFrames frames;
  frames.odom_frame = odom_frame;
  frames.base_frame = camera_frame;
  frames.T_odom_o.linear() = bodyFromOptical();
  return frames;
}

OdometryFrames OdometryFrames::ofBase(const std::string& odom_frame, const std::string& base_frame,
                                      const Eigen::Isometry3d& T_b_c) {
  OdometryFrames frames;
  frames.odom_frame = odom_frame;
  frames.base_frame = base_frame;
  frames.T_odom_o = T_b_c;
  frames.T_c_b = T_b_c.inverse();
  return frames;
}

void OdometryFrames::moveMounting(const Eigen::Isometry3d& T_b_c, double dt) {
  const Eigen::Isometry3d T_last_now = T_c_b * T_b_c;
  mounting_twist_c.setZero();
  if (dt > 0) {
    mounting_twist_c << T_last_now.linear().transpose() * T_last_now.translation() / dt,
        rotationVector(T_last_now.linear()) / dt;
  }
  T_c_b = T_b_c.inverse();
}

MetricPose PoseOrigin::relative(MetricPose pose) {
  const bool is_origin = std::exchange(waits_for_pose_, false);
  if (is_origin) T_o_origin_ = pose.T_o_c;
  if (!T_o_origin_) return pose;
  const Eigen::Isometry3d T_origin_o = T_o_origin_->inverse();
  pose.T_o_c = is_origin ? Eigen::Isometry3d::Identity() : T_origin_o * pose.T_o_c;
  const Matrix6d J = twistTransform(T_origin_o.linear(), Eigen::Vector3d::Zero());
  setCovariance(J, Matrix6d(pose.covariance), pose.covariance);
  return pose;
}

nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const OdometryFrames& frames,
                                      const ros::Time& stamp) {
  const Eigen::Vector3d base_in_c = frames.T_c_b.translation();

  auto msg = boost::make_shared<nav_msgs::Odometry>();
  msg->header.stamp = stamp;
  msg->header.frame_id = frames.odom_frame;
  msg->child_frame_id = frames.base_frame;
  msg->pose.pose = tf2::toMsg(frames.T_odom_o * pose.T_o_c * frames.T_c_b);
  setCovariance(twistTransform(frames.T_odom_o.linear(), pose.T_o_c.linear() * base_in_c),
                pose.covariance, msg->pose.covariance);

  const Matrix6d J = twistTransform(frames.T_c_b.linear().transpose(), base_in_c);
  const Vector6d twist_b = J * (pose.twist_c - frames.mounting_twist_c);
  msg->twist.twist = tf2::toMsg(twist_b);
  setCovariance(J, pose.twist_covariance, msg->twist.covariance);
  return msg;
}

geometry_msgs::TransformStamped toTransformMsg(const nav_msgs::Odometry& odometry) {
  geometry_msgs::TransformStamped transform;
  transform.header = odometry.header;
  transform.child_frame_id = odometry.child_frame_id;
  transform.transform.translation.x = odometry.pose.pose.position.x;
  transform.transform.translation.y = odometry.pose.pose.position.y;
  transform.transform.translation.z = odometry.pose.pose.position.z;
  transform.transform.rotation = odometry.pose.pose.orientation;
  return transform;
}

}  // namespace ground_scale_vo
