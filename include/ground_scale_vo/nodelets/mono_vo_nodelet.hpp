#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/nodelets/stage_nodelet.hpp"
#include "ground_scale_vo/ros/image_input.hpp"
#include "ground_scale_vo/ros/visuals.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"

namespace ground_scale_vo {

/// image + camera_info -> vo/frame, vo/odometry; for visualisation vo/image_tracks, vo/points.
/// Services ~reset, and with refine_camera ~save_camera.
///
/// Bundle adjustment has a thread of its own (Mapping), and feature tracking uses OpenCV's threads
/// (parallelLoop()). The image callback only stores the image; a posted task processes one stored
/// image after all callbacks that wait. So the newest `queue_size` images are always in the queue,
/// and dropped ones are counted exactly. Images wait for the first valid camera_info.
class MonoVoNodelet : public StageNodelet {
 public:
  ~MonoVoNodelet() override { stopCallbacks(); }

 private:
  struct GreyImage {
    sensor_msgs::ImageConstPtr message;  ///< `grey` may refer to its data
    cv::Mat grey;                        ///< as it comes
    std::shared_ptr<const CameraCalibration> camera;
  };

  void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) override;
  std::string reset() override;
  std::string stage() const override { return "odometry"; }
  void describe(StageState* state) override;
  void addValues(diagnostic_updater::DiagnosticStatusWrapper& status) override;

  void onImage(const sensor_msgs::ImageConstPtr& image);
  /// Posts a task that processes the oldest stored image, unless one is pending or none can run.
  void scheduleProcessing();
  /// Converts the image and processes those that the stamp filter accepts.
  void convert(const sensor_msgs::ImageConstPtr& image);
  void process(const GreyImage& image, bool clock_jumped_back);
  /// Why the odometry starts anew with this image, so that sequence and map ids are 0 again; empty:
  /// it continues.
  std::string restartReason(const GreyImage& image, bool clock_jumped_back) const;
  void publish(const SelfCalibratingOdometry::Output& output, const std_msgs::Header& header);
  void publishLens(const std_msgs::Header& header);
  std::string saveCamera() const;

  MonoVoParams params_;
  std::unique_ptr<ImageReceiver> receiver_;
  std::deque<sensor_msgs::ImageConstPtr> images_;
  std::uint64_t dropped_from_queue_ = 0;
  bool processing_scheduled_ = false;
  std::unique_ptr<StampFilter<GreyImage>> stamp_filter_;

  std::unique_ptr<SelfCalibratingOdometry> odometry_;  ///< null: the next image starts one
  std::shared_ptr<const CameraCalibration> odometry_camera_;
  TrackPainter painter_;
  std::optional<VoFrame> last_frame_;  ///< of odometry_

  ros::Publisher frame_publisher_, odometry_publisher_, points_publisher_;
  ros::Publisher refined_camera_publisher_;
  image_transport::Publisher tracks_publisher_;
};

}  // namespace ground_scale_vo
