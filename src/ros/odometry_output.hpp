#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <ros/ros.h>
#include <std_msgs/Header.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/scale/metric_pose.hpp"
#include "ros/diagnostics.hpp"
#include "ros/params.hpp"

// The metric poses as messages and on tf.
namespace gsv {

/// Rotation from optical axes (x right, y down, z forward) to body axes (x forward, y left, z up).
Eigen::Matrix3d bodyFromOptical();

/// The tf frames of the metric odometry: the pose of base_frame (b) in odom_frame.
struct TfFrames {
  std::string odom_frame;
  std::string base_frame;
  /// o is the core's metric frame, see MetricPose.
  Eigen::Isometry3d T_odom_o = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_c_b = Eigen::Isometry3d::Identity();
  /// Twist of the camera relative to the base, in camera axes: linear [m/s], then angular [rad/s].
  Vector6d mounting_twist_c = Vector6d::Zero();

  /// base_frame is the camera: odom has the origin of o, x forward, y left and z up.
  static TfFrames ofCamera(const std::string& odom_frame, const std::string& camera_frame) {
    return {odom_frame, camera_frame, Eigen::Isometry3d(bodyFromOptical())};
  }
  /// odom is the frame of the base whose camera coincides with o.
  static TfFrames ofBase(const std::string& odom_frame, const std::string& base_frame,
                         const Eigen::Isometry3d& T_b_c) {
    return {odom_frame, base_frame, T_b_c, T_b_c.inverse()};
  }
  /// The camera has moved on the base to T_b_c, in dt [s]. odom stays where it is.
  void moveMounting(const Eigen::Isometry3d& T_b_c, double dt);
};

/// Pose of the base in odom with its covariance; twist of the base at its origin and in its axes
/// (REP-103, REP-105) with its covariance. The adjoint of the frames propagates the covariances.
nav_msgs::Odometry::Ptr toOdometryMsg(const MetricPose& pose, const TfFrames& frames,
                                      const ros::Time& stamp);

/// The same pose for tf: header.frame_id -> child_frame_id.
geometry_msgs::TransformStamped toTransformMsg(const nav_msgs::Odometry& odometry);

/// A path for display, with poses at least a spacing apart. A full path drops every second one and
/// doubles the spacing.
class BoundedPath {
 public:
  /// frame: of the poses. Preconditions: max_poses >= 2, spacing_m >= 0.
  BoundedPath(int max_poses, double spacing_m, const std::string& frame = {})
      : max_poses_(static_cast<std::size_t>(max_poses)),
        initial_spacing_m_(spacing_m),
        spacing_m_(spacing_m) {
    path_.header.frame_id = frame;
  }

  /// True if the pose was added.
  bool add(const nav_msgs::Odometry& odometry);
  void clear() {
    path_.poses.clear();
    spacing_m_ = initial_spacing_m_;
  }
  const nav_msgs::Path& message() const { return path_; }

 private:
  const std::size_t max_poses_;
  const double initial_spacing_m_;
  double spacing_m_;
  nav_msgs::Path path_;
};

/// The parents of tf frames, to find out whether a frame that is to be broadcast is broadcast by
/// another node already; tf2 reports neither a second parent nor a second broadcaster.
class FrameParents {
 public:
  using Clock = std::chrono::steady_clock;

  /// own_parent: of the transforms that this node broadcasts itself, which do not count; empty: the
  /// message is from another node.
  void add(const tf2_msgs::TFMessage& message, bool is_static, Clock::time_point now,
           const std::string& own_parent = {});

  /// The frame's parent; empty: none, or not broadcast any more.
  std::string parentOf(const std::string& frame, Clock::time_point now) const;
  /// The frame at the top of the chain of static transforms to this frame; the frame itself if
  /// there is none.
  std::string staticRoot(const std::string& frame) const;

  /// Time after the last message in which a transform on tf counts as broadcast.
  static constexpr Clock::duration kMemory = std::chrono::seconds(5);

 private:
  /// child -> parent -> last message; kStatic: of tf_static.
  std::map<std::string, std::map<std::string, Clock::time_point>> parents_;
};

/// Publishes `odometry`, `path` and on tf odom_frame -> base_frame. Works in the callback queue of
/// the node handle.
class OdometryOutput {
 public:
  OdometryOutput(ros::NodeHandle& handle, const ScaleRecoveryParams& params, WarningLog* log);

  /// pose: of the camera at this image; empty: not known.
  void publish(const std::optional<MetricPose>& pose, const std_msgs::Header& image);
  /// A new trajectory. The mounting is looked up again.
  void restart(bool first_pose_is_zero);

  /// The frames of the last pose; empty: there is none yet.
  const std::optional<TfFrames>& frames() const { return tf_frames_; }
  /// Why the last image has no pose although the scale may be known; empty: it has one.
  const std::string& mountingError() const { return mounting_error_; }
  /// Why the pose is not broadcast on tf: another node broadcasts the frame there, from this or
  /// another parent. Empty: none does, or publish_tf is false.
  std::string otherBroadcasterError() const;

 private:
  bool findFrames(const std_msgs::Header& image);
  Eigen::Isometry3d lookUpMounting(const std_msgs::Header& image) const;
  bool isOfLastPass(const ros::Time& stamp);

  const ScaleRecoveryParams params_;
  WarningLog* const log_;
  std::optional<TfFrames> tf_frames_;
  ros::Time mounting_stamp_;  ///< of the image that tf_frames_ is from
  std::string mounting_error_;
  bool next_pose_is_zero_ = false;
  ros::Time latest_clock_;  ///< since the last restart
  BoundedPath path_;
  FrameParents frame_parents_;

  ros::Publisher odometry_publisher_, path_publisher_;
  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> tf_broadcaster_;
  std::vector<ros::Subscriber> tf_subscribers_;
};

}  // namespace gsv
