#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <image_transport/image_transport.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/input/stamp_guard.hpp"
#include "ground_scale_vo/nodelets/dedicated_spinner.hpp"
#include "ground_scale_vo/ros/bounded_queue.hpp"
#include "ground_scale_vo/ros/image_receiver.hpp"
#include "ground_scale_vo/ros/missing_input_log.hpp"
#include "ground_scale_vo/ros/params.hpp"
#include "ground_scale_vo/ros/rate_meter.hpp"
#include "ground_scale_vo/ros/visuals.hpp"
#include "ground_scale_vo/ros/warning_log.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace ground_scale_vo {

/// image + camera_info -> vo/frame, vo/odometry; for visualisation vo/image_tracks, vo/points.
/// Services ~reset, and with refine_camera ~save_camera.
///
/// All callbacks run on the thread of the DedicatedSpinner. Bundle adjustment has a second one
/// (Mapping), and feature tracking uses OpenCV's threads (parallelLoop()). The image callback only
/// stores the image; a posted task processes one stored image after all callbacks that wait. So the
/// newest `queue_size` images are always in the queue, and dropped ones are counted exactly. Images
/// wait for the first valid camera_info.
class MonoVoNodelet : public nodelet::Nodelet {
 public:
  ~MonoVoNodelet() override;

 private:
  struct RectifiedImage {
    sensor_msgs::ImageConstPtr message;  ///< `grey` may refer to its data
    cv::Mat grey;  ///< rectified; with refine_camera as CalibratedCamera::given()
    std::shared_ptr<const CalibratedCamera> camera;
    cv::Mat mask;  ///< of `grey`
  };

  void onInit() override;
  void start();
  void advertise(ros::NodeHandle& handle, ros::NodeHandle& private_handle);
  bool onReset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  void onImage(const sensor_msgs::ImageConstPtr& image);

  /// Posts a task that processes the oldest stored image, unless one is pending or none can run.
  void scheduleProcessing();
  /// Rectifies the image and processes those that the stamp filter accepts.
  void rectify(const sensor_msgs::ImageConstPtr& image);
  void process(const RectifiedImage& image, bool clock_jumped_back);
  /// Constructs the odometry if there is none, and again if the camera changed or the clock jumped
  /// back.
  void prepareOdometry(const RectifiedImage& image, bool clock_jumped_back);
  void publish(const SelfCalibratingOdometry::Output& output, const std_msgs::Header& header);
  void publishLens(const std_msgs::Header& header);
  bool onSaveCamera(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  /// Counts a dropped message and warns about it.
  void drop(const std::string& kind, const std::string& reason);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);
  /// Warns in the log, too, when the input is missing.
  void warnOfMissingInput(const MonoVoState& state);

  DedicatedSpinner callbacks_;  // the first member, see DedicatedSpinner
  MonoVoParams params_;

  // Input.
  ros::ServiceServer reset_server_, save_camera_server_;
  std::unique_ptr<ImageReceiver> receiver_;
  std::unique_ptr<BoundedQueue<sensor_msgs::ImageConstPtr>> images_;
  bool processing_scheduled_ = false;
  std::unique_ptr<StampFilter<RectifiedImage>> stamp_filter_;

  // Odometry.
  std::unique_ptr<SelfCalibratingOdometry> odometry_;
  std::shared_ptr<const CalibratedCamera> odometry_camera_;
  TrackPainter painter_;

  // Output.
  ros::Publisher frame_publisher_, odometry_publisher_, points_publisher_;
  ros::Publisher refined_camera_publisher_;
  image_transport::Publisher tracks_publisher_;

  // Diagnostics.
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;
  WarningLog warnings_;
  MissingInputLog missing_input_log_;
  bool has_warned_of_slash_ = false;  ///< in a frame name
  RateMeter rate_;                    ///< of processed_
  std::uint64_t processed_ = 0;
  std::optional<Stopwatch> since_processed_;
  std::uint64_t dropped_from_queue_ = 0;
  std::uint64_t dropped_at_last_diagnosis_ = 0;
  std::optional<VoStatus> status_;
  std::uint32_t map_id_ = 0;
  std::size_t features_ = 0, points_ = 0;
  double frame_ms_ = 0;
};

}  // namespace ground_scale_vo
