#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <image_transport/image_transport.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/nodelets/dedicated_spinner.hpp"
#include "ground_scale_vo/ros/bounded_queue.hpp"
#include "ground_scale_vo/ros/camera_stream.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/fault_log.hpp"
#include "ground_scale_vo/ros/params.hpp"
#include "ground_scale_vo/ros/rate_meter.hpp"
#include "ground_scale_vo/ros/stamp_guard.hpp"
#include "ground_scale_vo/ros/visuals.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"

namespace ground_scale_vo {

/// image + camera_info -> vo/frame, vo/odometry, and to look at vo/image_tracks, vo/points.
///
/// The callbacks only store; the work is done on a thread of its own, one image after the other.
/// Images wait in a queue of `queue_size` (newest wins) and until the first usable camera_info.
class MonoVoNodelet : public nodelet::Nodelet {
 public:
  ~MonoVoNodelet() override;

 private:
  /// What the diagnostics tell, written by the callbacks and the working thread.
  struct State {
    std::uint64_t received = 0, processed = 0, overtaken = 0;
    std::optional<Stopwatch> since_received;
    std::string info_refused;  ///< why the last camera_info was; empty: it was accepted
    std::optional<VoStatus> status;
    std::uint32_t map_id = 0;
    std::size_t features = 0, points = 0;
    double frame_ms = 0;
  };

  void onInit() override;
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void onImage(const sensor_msgs::ImageConstPtr& image);

  void work();
  void process(const sensor_msgs::Image& image);
  /// A new odometry when there is none or the camera or the clock demand it.
  void prepareOdometry(const std::shared_ptr<const CalibratedCamera>& camera,
                       bool clock_jumped_back);
  void publish(const cv::Mat& rectified, const VisualOdometry::Output& output,
               const std_msgs::Header& header);

  void drop(const std::string& kind, const std::string& why);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  DedicatedSpinner callbacks_;
  MonoVoParams params_;
  FaultLog faults_;

  std::unique_ptr<image_transport::ImageTransport> transport_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber camera_info_subscriber_;
  ros::Publisher frame_publisher_, odometry_publisher_, points_publisher_;
  image_transport::Publisher tracks_publisher_;
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;

  std::unique_ptr<CameraStream> stream_;
  std::mutex mutex_;  ///< guards state_
  State state_;
  RateMeter rate_;              ///< of processed
  std::uint64_t left_out_ = 0;  ///< at the last diagnosis

  // Of the working thread alone.
  std::shared_ptr<const CalibratedCamera> odometry_camera_;
  std::unique_ptr<VisualOdometry> odometry_;
  std::unique_ptr<StampGuard> guard_;
  GreyConverter grey_;
  TrackPainter painter_;

  std::unique_ptr<BoundedQueue<sensor_msgs::ImageConstPtr>> images_;
  std::thread thread_;
};

}  // namespace ground_scale_vo
