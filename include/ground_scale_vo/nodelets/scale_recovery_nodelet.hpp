#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <image_transport/image_transport.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/input/stamp_guard.hpp"
#include "ground_scale_vo/nodelets/dedicated_spinner.hpp"
#include "ground_scale_vo/ros/bounded_path.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/frame_image_synchronizer.hpp"
#include "ground_scale_vo/ros/frame_parents.hpp"
#include "ground_scale_vo/ros/image_receiver.hpp"
#include "ground_scale_vo/ros/map_numbering.hpp"
#include "ground_scale_vo/ros/missing_input_log.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"
#include "ground_scale_vo/ros/params.hpp"
#include "ground_scale_vo/ros/rate_meter.hpp"
#include "ground_scale_vo/ros/sequence_check.hpp"
#include "ground_scale_vo/ros/turn_axis.hpp"
#include "ground_scale_vo/ros/warning_log.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// vo/frame, and image + camera_info if used -> scale, odometry, path, tf; for visualisation
/// image_road, points, ground_points, ground_plane. Service ~reset.
///
/// All callbacks but those of tf2_ros::TransformListener, which has its own thread, run on the
/// thread of the DedicatedSpinner. A frame is processed with the image of the same stamp
/// (FrameImageSynchronizer); without an image only feature-based measurements are made.
class ScaleRecoveryNodelet : public nodelet::Nodelet {
 public:
  ~ScaleRecoveryNodelet() override;

 private:
  struct ReceivedFrame {
    VoFrame frame;
    std_msgs::Header header;
  };
  using Synchronizer = FrameImageSynchronizer<ReceivedFrame, sensor_msgs::ImageConstPtr>;

  void onInit() override;
  void start();
  void advertise(ros::NodeHandle& handle, ros::NodeHandle& private_handle);
  void subscribeToImages(ros::NodeHandle& handle, ros::NodeHandle& private_handle);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFrame(const VoFrameMsg::ConstPtr& msg);
  bool onReset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  /// Processes the frames that do not wait for their image; all of them unless they may_wait.
  void processReady(bool may_wait = true);
  void process(VoFrame frame, const std_msgs::Header& header,
               const sensor_msgs::ImageConstPtr& image);
  /// The image on which the odometry worked, and its mask; empty if there is none or it cannot be
  /// used.
  struct FrameImage {
    cv::Mat image, mask;
  };
  FrameImage frameImage(const VoFrame& frame, const sensor_msgs::ImageConstPtr& image);
  FrameImage refinedImage(const VoFrame& frame, const sensor_msgs::Image& image);
  /// Processes the waiting frames, then resets; the first metric pose is zero.
  void startAtNextPose();
  void reset();
  /// Starts at the next pose if the frame has another frame_id than the last one that has one.
  void resetForAnotherCamera(const std::string& camera_frame);
  /// The frames to publish the motion of this camera in; null while tf lacks its mounting or its
  /// frame_id is empty.
  const OdometryFrames* odometryFrames(const std_msgs::Header& header);
  /// Pose of the camera in base_frame, from tf: at the stamp with moving_mount, else the latest
  /// one. Throws tf2::TransformException or MessageError.
  Eigen::Isometry3d lookUpMounting(const std_msgs::Header& header);
  /// Checks the measured mounting and that from tf; warns once until a reset.
  void checkMounting(const ScaleRecovery::Output& output);
  void publish(const ScaleRecovery::Output& output, const VoFrame& frame, const cv::Mat& rectified,
               const cv::Mat& mask, const std_msgs::Header& header);
  void publishPose(const MetricPose& pose, const OdometryFrames& frames, const ros::Time& stamp);
  /// /clock has jumped back, as in a looped bag, but the stamps of the frames have not yet. On tf
  /// such a frame would be in the future, and tf2 would then ignore the new pass.
  bool isOfLastPass(const ros::Time& stamp);
  void publishPath();
  void publishGround(const ScaleRecovery::Output& output, const std_msgs::Header& header);

  /// Why the pose is not broadcast on tf: the frame has another parent there. Empty: it has none,
  /// or publish_tf is false.
  std::string otherParentError() const;
  void warn(const std::string& kind, const std::string& text);
  /// Counts a dropped message and warns about it.
  void drop(const std::string& kind, const std::string& reason);
  /// Keeps what the diagnostics report about the frame.
  void record(const ScaleRecovery::Output& output, const ros::Time& stamp, bool has_image);
  std::string imageState() const;
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);
  /// Warns in the log, too, when the input is missing.
  void warnOfMissingInput(const ScaleRecoveryState& state);
  void addValues(diagnostic_updater::DiagnosticStatusWrapper& status);

  DedicatedSpinner callbacks_;  // the first member, see DedicatedSpinner
  ScaleRecoveryParams params_;

  // Input.
  std::unique_ptr<ImageReceiver> receiver_;  ///< null: images are not used
  /// The camera as the odometry has refined it.
  struct RefinedCamera {
    std::shared_ptr<const CalibratedCamera> given;
    CameraCalibration calibration;
    Undistortion undistortion;
    cv::Mat mask;
  };
  std::optional<RefinedCamera> refined_;
  std::unique_ptr<Synchronizer> synchronizer_;
  ros::WallTimer waiting_timer_;
  ros::Subscriber frame_subscriber_;
  ros::ServiceServer reset_server_;
  std::unique_ptr<StampFilter<ReceivedFrame>> stamp_filter_;
  MapNumbering map_numbering_;
  SequenceCheck sequence_check_;
  std::string camera_frame_;  ///< frame_id of the last frame that has one

  // Scale recovery.
  std::unique_ptr<ScaleRecovery> recovery_;

  // Output.
  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> tf_broadcaster_;
  std::vector<ros::Subscriber> tf_subscribers_;
  FrameParents frame_parents_;
  ros::Time latest_clock_;  ///< since the last backward jump of the frames
  std::optional<OdometryFrames> odometry_frames_;
  ros::Time mounting_stamp_;      ///< of the image that odometry_frames_ is from
  std::string mounting_error_;    ///< why odometryFrames() was null for the last frame; else empty
  std::string mounting_warning_;  ///< of the last frame
  TurnAxis turn_axis_;
  bool has_warned_of_mounting_ = false;
  PoseOrigin pose_origin_;
  std::unique_ptr<BoundedPath> path_;
  ros::Publisher odometry_publisher_, path_publisher_, scale_publisher_;
  ros::Publisher points_publisher_, ground_points_publisher_, ground_plane_publisher_;
  image_transport::Publisher road_publisher_;

  // Diagnostics.
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;
  WarningLog warnings_;        ///< of dropped messages
  WarningLog other_warnings_;  ///< of messages that are used
  MissingInputLog missing_input_log_;
  RateMeter rate_;  ///< of processed_
  std::optional<Stopwatch> since_frame_, since_processed_;
  std::uint64_t processed_ = 0, processed_with_image_ = 0, with_direct_ = 0;
  std::uint64_t processed_at_last_diagnosis_ = 0, with_image_at_last_diagnosis_ = 0;
  std::uint64_t dropped_at_last_diagnosis_ = 0;
  bool last_frame_had_image_ = false;
  double frame_ms_ = 0;
  ScaleEstimate last_scale_;
  ros::Time last_stamp_, last_measurement_;
  /// First of the latest HELD frames in a row without standstill; zero: the last frame is none.
  ros::Time held_since_;
  double distance_m_ = 0;
};

}  // namespace ground_scale_vo
