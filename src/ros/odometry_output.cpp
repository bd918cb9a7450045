#include "ros/odometry_output.hpp"

#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <utility>

#include "common/time.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace gsv {
namespace {

/// [m] least spacing of a path after a thinning: an initial spacing may be zero.
constexpr double kMinDoubledSpacing = 0.1;

constexpr std::uint32_t kTfQueue = 100;  // [messages] that wait for their callback

/// [s] wall time to wait for tf with moving_mount, which may come later than the image.
constexpr double kMountingWaitS = 0.2;
constexpr double kMountingPollS = 0.002;

/// Time of a transform on tf_static, which counts as broadcast for ever.
constexpr auto kStatic = FrameParents::Clock::time_point::max();

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

Eigen::Matrix3d bodyFromOptical() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return R;
}

void TfFrames::moveMounting(const Eigen::Isometry3d& T_b_c, double dt) {
  mounting_twist_c.setZero();
  if (dt > 0) mounting_twist_c = meanTwist(T_c_b * T_b_c, dt);
  T_c_b = T_b_c.inverse();
}

nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const TfFrames& frames,
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

bool BoundedPath::add(const nav_msgs::Odometry& odometry) {
  auto& poses = path_.poses;
  const auto& p = odometry.pose.pose.position;
  if (!poses.empty()) {
    const auto& last = poses.back().pose.position;
    if (std::hypot(p.x - last.x, p.y - last.y, p.z - last.z) < spacing_m_) return false;
  }
  if (poses.size() == max_poses_) {
    for (std::size_t i = 0; 2 * i < poses.size(); ++i) poses[i] = poses[2 * i];
    poses.resize((poses.size() + 1) / 2);
    spacing_m_ = std::max(2.0 * spacing_m_, kMinDoubledSpacing);
  }
  poses.emplace_back();
  poses.back().header = path_.header = odometry.header;
  poses.back().pose = odometry.pose.pose;
  return true;
}

void FrameParents::add(const tf2_msgs::TFMessage& message, bool is_static, Clock::time_point now,
                       const std::string& own_parent) {
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    const std::string parent = withoutLeadingSlashes(transform.header.frame_id);
    if (!own_parent.empty() && parent == own_parent) continue;
    parents_[withoutLeadingSlashes(transform.child_frame_id)][parent] = is_static ? kStatic : now;
  }
}

std::string FrameParents::parentOf(const std::string& frame, Clock::time_point now) const {
  const auto found = parents_.find(frame);
  if (found == parents_.end()) return {};
  for (const auto& [name, last] : found->second) {
    if (now - last <= kMemory) return name;
  }
  return {};
}

std::string FrameParents::staticRoot(const std::string& frame) const {
  std::string root = frame;
  for (std::size_t n = 0; n < parents_.size(); ++n) {  // a cycle is an error of the sender
    const auto found = parents_.find(root);
    if (found == parents_.end()) break;
    for (const auto& [parent, last] : found->second) {
      if (last == kStatic) root = parent;
    }
  }
  return root;
}

OdometryOutput::OdometryOutput(ros::NodeHandle& handle, const ScaleRecoveryParams& params,
                               WarningLog* log)
    : params_(params),
      log_(log),
      path_(params.path_max_poses, params.path_spacing_m, params.odom_frame) {
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("odometry", kPublishQueue);
  // Latched. It is published only while it has subscribers, so the latched message may be old: each
  // new subscriber causes a new one.
  path_publisher_ = handle.advertise<nav_msgs::Path>(
      "path", 1,
      [this](const ros::SingleSubscriberPublisher&) { path_publisher_.publish(path_.message()); },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
  if (!params_.base_frame.empty()) {
    tf_buffer_ = std::make_unique<tf2_ros::Buffer>();
    tf_listener_ = std::make_unique<tf2_ros::TransformListener>(*tf_buffer_, handle);
  }
  if (!params_.publish_tf) return;
  tf_broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
  for (const bool is_static : {false, true}) {
    using Event = ros::MessageEvent<const tf2_msgs::TFMessage>;
    tf_subscribers_.push_back(handle.subscribe<tf2_msgs::TFMessage>(
        is_static ? "/tf_static" : "/tf", kTfQueue,
        boost::function<void(const Event&)>([this, is_static](const Event& event) {
          const bool is_own = event.getPublisherName() == ros::this_node::getName();
          frame_parents_.add(*event.getMessage(), is_static, FrameParents::Clock::now(),
                             is_own ? params_.odom_frame : "");
        })));
  }
}

void OdometryOutput::restart(bool first_pose_is_zero) {
  tf_frames_.reset();
  mounting_error_.clear();
  next_pose_is_zero_ = first_pose_is_zero;
  latest_clock_ = ros::Time();
  path_.clear();
  path_publisher_.publish(path_.message());
}

void OdometryOutput::publish(const std::optional<MetricPose>& pose, const std_msgs::Header& image) {
  mounting_error_.clear();
  // With a moving mount from the first image on: odom is the base at the origin.
  if (!(pose || params_.moving_mount) || !findFrames(image) || !pose) return;
  if (std::exchange(next_pose_is_zero_, false)) {
    tf_frames_->T_odom_o = tf_frames_->T_odom_o * pose->T_o_c.inverse();
  }
  const nav_msgs::Odometry::ConstPtr odometry = toOdometryMsg(*pose, *tf_frames_, image.stamp);
  odometry_publisher_.publish(odometry);
  if (const std::string error = otherBroadcasterError(); !error.empty()) {
    log_->error("tf", error);
  } else if (tf_broadcaster_ && !isOfLastPass(image.stamp)) {
    tf_broadcaster_->sendTransform(toTransformMsg(*odometry));
  }
  if (path_.add(*odometry) && path_publisher_.getNumSubscribers() > 0) {
    path_publisher_.publish(path_.message());
  }
}

/// Sets tf_frames_ for this image. False while tf lacks the mounting or the frame_id is empty.
bool OdometryOutput::findFrames(const std_msgs::Header& image) {
  if (image.frame_id.empty()) {
    mounting_error_ = "the frame_id of the images is empty: no metric pose is published";
    log_->warn("no frame_id", mounting_error_);
    return false;
  }
  const bool is_camera = params_.base_frame.empty() || params_.base_frame == image.frame_id;
  if (is_camera && !tf_frames_) tf_frames_ = TfFrames::ofCamera(params_.odom_frame, image.frame_id);
  if (tf_frames_ && (is_camera || !params_.moving_mount || mounting_stamp_ == image.stamp)) {
    return true;
  }
  try {
    const Eigen::Isometry3d T_b_c = lookUpMounting(image);
    if (tf_frames_) {
      tf_frames_->moveMounting(T_b_c, (image.stamp - mounting_stamp_).toSec());
    } else {
      tf_frames_ = TfFrames::ofBase(params_.odom_frame, params_.base_frame, T_b_c);
    }
  } catch (const std::exception& error) {
    mounting_error_ = "no tf transform from base_frame \"" + params_.base_frame +
                      "\" to the camera frame \"" + image.frame_id +
                      "\": no metric pose is published";
    log_->error("no tf", mounting_error_ + ": " + error.what());
    return false;
  }
  mounting_stamp_ = image.stamp;
  return true;
}

/// Pose of the camera in base_frame, from tf: at the stamp with moving_mount, else the latest one.
/// Throws tf2::TransformException or DataError.
Eigen::Isometry3d OdometryOutput::lookUpMounting(const std_msgs::Header& image) const {
  const ros::Time stamp = params_.moving_mount ? image.stamp : ros::Time(0);
  // In wall time: the timeout of tf2 never ends while the clock of a bag is stopped.
  const Stopwatch watch;
  while (params_.moving_mount && watch.seconds() < kMountingWaitS &&
         !tf_buffer_->canTransform(params_.base_frame, image.frame_id, stamp)) {
    ros::WallDuration(kMountingPollS).sleep();
  }
  return fromMsg(tf_buffer_->lookupTransform(params_.base_frame, image.frame_id, stamp).transform);
}

/// /clock has jumped back, as in a looped bag, but the stamps of the frames have not yet. On tf
/// such a frame would be in the future, and tf2 would then ignore the new pass.
bool OdometryOutput::isOfLastPass(const ros::Time& stamp) {
  if (!ros::Time::isSimTime()) return false;
  const ros::Time now = ros::Time::now();
  latest_clock_ = std::max(latest_clock_, now);
  // Not by the stamp alone: the stamps in a bag may always be ahead of its clock.
  const double jump_s = params_.clock_jump_s;
  return (latest_clock_ - now).toSec() > jump_s && (stamp - now).toSec() > jump_s;
}

std::string OdometryOutput::otherBroadcasterError() const {
  if (!tf_broadcaster_ || !tf_frames_) return {};
  const std::string& child = tf_frames_->base_frame;
  const std::string parent = frame_parents_.parentOf(child, FrameParents::Clock::now());
  if (parent.empty()) return {};
  const std::string root = frame_parents_.staticRoot(child);
  return "frame \"" + child + "\" has the parent \"" + parent + "\" on tf" +
         (parent == params_.odom_frame ? " from another node" : "") + ", so " + params_.odom_frame +
         " -> " + child + " is not broadcast; set " +
         (root == child ? "publish_tf to false, or stop the other publisher"
                        : "base_frame to \"" + root + "\"");
}

}  // namespace gsv
