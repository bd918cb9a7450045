#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "ground_scale_vo/ros/bounded_path.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/fault_log.hpp"
#include "ground_scale_vo/ros/params.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// vo/frame -> scale, odometry, path, tf, and to look at ground_points, ground_plane; service
/// reset.
///
/// Everything runs on the nodelet's single-threaded queue.
class ScaleRecoveryNodelet : public nodelet::Nodelet {
 public:
  ~ScaleRecoveryNodelet() override;

 private:
  void onInit() override;
  void onFrame(const VoFrameMsg::ConstPtr& msg);
  bool onReset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  void reset();
  /// An odometry that was restarted counts its maps from 0 again; they are new ones all the same.
  void renumberMap(VoFrame& frame);
  /// How to tell the motion of this camera; empty while tf does not know where it is mounted.
  const OdometryFrames* framesFor(const std::string& camera_frame);
  void publishPose(const MetricPose& pose, const std_msgs::Header& header);
  void publishGround(const ScaleRecovery::Output& output, const std_msgs::Header& header);

  void report(const std::string& kind, const std::string& why);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  ScaleRecoveryParams params_;
  FaultLog faults_;
  std::unique_ptr<ScaleRecovery> recovery_;
  std::unique_ptr<StampGuard> guard_;
  std::unique_ptr<BoundedPath> path_;

  /// Since the last frame of the odometry before: what its maps are renumbered with.
  std::optional<std::uint32_t> last_sequence_;
  std::uint32_t last_map_id_ = 0;
  std::uint32_t map_offset_ = 0;

  std::optional<OdometryFrames> frames_;
  std::string frames_camera_;

  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> tf_broadcaster_;
  ros::Subscriber frame_subscriber_;
  ros::ServiceServer reset_server_;
  ros::Publisher odometry_publisher_, path_publisher_, scale_publisher_;
  ros::Publisher ground_points_publisher_, ground_plane_publisher_;

  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;
  std::uint64_t processed_ = 0, diagnosed_ = 0;
  std::chrono::steady_clock::time_point diagnosed_at_;
  double frame_ms_ = 0;
  ScaleEstimate last_scale_;
  ros::Time last_stamp_, last_measured_;
  double distance_m_ = 0;
};

}  // namespace ground_scale_vo
