#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <image_transport/image_transport.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/nodelets/dedicated_spinner.hpp"
#include "ground_scale_vo/ros/bounded_path.hpp"
#include "ground_scale_vo/ros/camera_stream.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/fault_log.hpp"
#include "ground_scale_vo/ros/frame_image_pairing.hpp"
#include "ground_scale_vo/ros/params.hpp"
#include "ground_scale_vo/ros/rate_meter.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// vo/frame, and image + camera_info where there are any -> scale, odometry, path, tf, and to look
/// at image_road, points, ground_points, ground_plane; service reset.
///
/// Everything runs on one thread, in callbacks. A frame is processed with the image of its stamp
/// (FrameImagePairing), or on its points alone.
class ScaleRecoveryNodelet : public nodelet::Nodelet {
 public:
  ~ScaleRecoveryNodelet() override;

 private:
  /// A frame as it came, with what its message says beyond the core's type.
  struct Arrived {
    VoFrame frame;
    std_msgs::Header header;
  };
  using Pairing = FrameImagePairing<Arrived, sensor_msgs::ImageConstPtr>;

  void onInit() override;
  void useImages(ros::NodeHandle& handle, ros::NodeHandle& private_handle);
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFrame(const VoFrameMsg::ConstPtr& msg);
  bool onReset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  /// Every frame that need not wait for its image; all of them unless they may_wait.
  void processReady(bool may_wait = true);
  void process(VoFrame frame, const std_msgs::Header& header,
               const sensor_msgs::ImageConstPtr& image);
  /// The picture of the frame; empty when there is none or it cannot be used.
  cv::Mat pictureOf(const VoFrame& frame, const sensor_msgs::ImageConstPtr& image);
  void reset();
  /// An odometry that was restarted counts its maps from 0 again; they are new ones all the same.
  void renumberMap(VoFrame& frame);
  /// How to tell the motion of this camera; empty while tf does not know where it is mounted.
  const OdometryFrames* framesFor(const std::string& camera_frame);
  void publishPose(const MetricPose& pose, const std_msgs::Header& header);
  void publishGround(const ScaleRecovery::Output& output, const std_msgs::Header& header);

  void report(const std::string& kind, const std::string& why);
  std::string imagesState() const;
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  DedicatedSpinner callbacks_;
  ScaleRecoveryParams params_;
  FaultLog faults_;
  std::unique_ptr<ScaleRecovery> recovery_;
  std::unique_ptr<StampGuard> guard_;
  std::unique_ptr<BoundedPath> path_;
  std::unique_ptr<CameraStream> stream_;
  GreyConverter grey_;
  std::unique_ptr<Pairing> pairing_;

  /// Since the last frame of the odometry before: what its maps are renumbered with.
  std::optional<std::uint32_t> last_sequence_;
  std::uint32_t last_map_id_ = 0;
  std::uint32_t map_offset_ = 0;

  std::optional<OdometryFrames> frames_;
  std::string frames_camera_;
  std::string no_frames_;  ///< why there were none when they were last asked for in vain

  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> tf_broadcaster_;
  /// These only when images are used.
  std::unique_ptr<image_transport::ImageTransport> transport_;
  image_transport::Subscriber image_subscriber_;
  image_transport::Publisher road_publisher_;
  ros::Subscriber camera_info_subscriber_;
  ros::WallTimer waiting_timer_;
  ros::Subscriber frame_subscriber_;
  ros::ServiceServer reset_server_;
  ros::Publisher odometry_publisher_, path_publisher_, scale_publisher_;
  ros::Publisher points_publisher_, ground_points_publisher_, ground_plane_publisher_;

  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;
  std::uint64_t processed_ = 0;
  RateMeter rate_;  ///< of processed_
  std::optional<Stopwatch> since_received_;
  // At the last diagnosis.
  std::uint64_t diagnosed_ = 0, left_out_ = 0, diagnosed_with_image_ = 0;
  std::optional<std::uint32_t> last_received_;  ///< its sequence number
  std::uint64_t overtaken_ = 0;
  std::uint64_t with_image_ = 0, refined_ = 0;
  bool last_had_image_ = false;
  double frame_ms_ = 0;
  ScaleEstimate last_scale_;
  ros::Time last_stamp_, last_measured_;
  ros::Time held_since_;  ///< zero while it is not held, or for want of motion
  double distance_m_ = 0;
};

}  // namespace ground_scale_vo
