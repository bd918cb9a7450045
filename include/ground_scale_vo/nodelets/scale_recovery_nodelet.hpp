#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/nodelets/stage_nodelet.hpp"
#include "ground_scale_vo/ros/frame_continuity.hpp"
#include "ground_scale_vo/ros/frame_image_synchronizer.hpp"
#include "ground_scale_vo/ros/image_input.hpp"
#include "ground_scale_vo/ros/mounting_check.hpp"
#include "ground_scale_vo/ros/odometry_output.hpp"
#include "ground_scale_vo/ros/speed_input.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// vo/frame, and image + camera_info and speed if used -> scale, odometry, path, tf; for
/// visualisation image_road, points, ground_points, ground_plane. Services ~reset, and with
/// use_speed ~save_height.
///
/// A frame is processed with the image of the same stamp (FrameImageSynchronizer); without an image
/// only feature-based measurements are made. tf2_ros::TransformListener has a thread of its own.
class ScaleRecoveryNodelet : public StageNodelet {
 public:
  ~ScaleRecoveryNodelet() override { stopCallbacks(); }

 private:
  struct ReceivedFrame {
    VoFrame frame;
    std_msgs::Header header;
  };
  using Synchronizer = FrameImageSynchronizer<ReceivedFrame, sensor_msgs::ImageConstPtr>;

  void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) override;
  std::string reset() override;
  std::string stage() const override { return "scale"; }
  void describe(StageState* state) override;
  void addValues(diagnostic_updater::DiagnosticStatusWrapper& status) override;

  void subscribeToImages(ros::NodeHandle& handle, ros::NodeHandle& private_handle);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFrame(const VoFrameMsg::ConstPtr& msg);
  void onSpeed(const topic_tools::ShapeShifter::ConstPtr& message);
  /// Processes the frames that do not wait for their image; all of them unless they may_wait.
  void processReady(bool may_wait = true);
  void process(const VoFrame& frame, const std_msgs::Header& header,
               const sensor_msgs::ImageConstPtr& image);
  /// A new trajectory with an unknown scale.
  void restart(bool first_pose_is_zero);

  void publish(const ScaleRecovery::Output& output, const VoFrame& frame, const CameraImage& image,
               const std_msgs::Header& header);
  void publishGround(const ScaleRecovery::Output& output, const VoFrame& frame,
                     const std_msgs::Header& header);
  /// Checks the measured mounting, that from tf, the camera height and the speeds.
  void check(const ScaleRecovery::Output& output, const VoFrame& frame);
  /// Keeps what the diagnostics report about the frame.
  void record(ScaleRecovery::Output output, std::int64_t stamp_ns, bool has_image);
  std::string imageState() const;
  std::string saveHeight() const;

  ScaleRecoveryParams params_;

  // Input.
  std::unique_ptr<ImageReceiver> receiver_;  ///< null: images are not used
  std::unique_ptr<Synchronizer> synchronizer_;
  ros::WallTimer waiting_timer_;
  ros::Subscriber frame_subscriber_;
  InputWatch frames_{"vo/frame"};
  std::unique_ptr<StampFilter<ReceivedFrame>> stamp_filter_;
  FrameContinuity continuity_;
  ros::Subscriber speed_subscriber_;  ///< with use_speed
  InputWatch speeds_{"speed"};
  SpeedReader speed_reader_;
  std::string speed_error_;  ///< why the newest speed was refused; empty: it was not
  std::optional<std::int64_t> newest_speed_ns_;

  std::unique_ptr<ScaleRecovery> recovery_;

  // Output.
  std::unique_ptr<OdometryOutput> odometry_;
  ros::Publisher scale_publisher_, points_publisher_, ground_points_publisher_,
      ground_plane_publisher_;
  image_transport::Publisher road_publisher_;

  /// What the diagnostics report of the trajectory.
  struct Report {
    TurnAxis turn_axis;
    std::vector<std::string> warnings;  ///< of the last frame
    std::set<std::string> logged;       ///< warnings without their numbers
    ScaleRecovery::Output last;
    std::int64_t stamp_ns = 0;
    std::optional<std::int64_t> measured_ns;  ///< last measurement
    /// First of the latest HELD frames in a row without standstill; empty: the last frame is none.
    std::optional<std::int64_t> held_since_ns;
    double distance_m = 0;
  };
  Report report_;
  std::uint64_t with_image_ = 0, with_direct_ = 0;  ///< frames
  std::uint64_t diagnosed_processed_ = 0, diagnosed_with_image_ = 0;
  bool last_frame_had_image_ = false;
};

}  // namespace ground_scale_vo
