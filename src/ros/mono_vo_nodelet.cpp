#include <nav_msgs/Odometry.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <deque>
#include <exception>
#include <memory>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <utility>

#include "common/files.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"
#include "ros/image_input.hpp"
#include "ros/odometry_output.hpp"
#include "ros/stage_nodelet.hpp"
#include "ros/visuals.hpp"

namespace ground_scale_vo {

/// image + camera_info -> vo/frame, vo/odometry, and vo/image with vo/mask, on which the odometry
/// worked; for visualisation vo/image_tracks, vo/points. Services ~reset, and with refine_camera
/// ~save_camera.
///
/// Bundle adjustment has a thread of its own (Mapping), and feature tracking uses OpenCV's threads
/// (trackPoints()). The image callback stores the image, a compressed one decoded; a posted task
/// processes one stored image after all callbacks that wait. So the newest `queue_size` images are
/// always in the queue, and dropped ones are counted exactly. Images wait for the first valid
/// camera_info.
class MonoVoNodelet : public StageNodelet {
 public:
  MonoVoNodelet() : StageNodelet("odometry") {}
  ~MonoVoNodelet() override { stopCallbacks(); }

 private:
  struct GreyImage {
    sensor_msgs::ImageConstPtr message;  ///< `grey` may refer to its data
    cv::Mat grey;
    std::shared_ptr<const CameraCalibration> camera;
  };

  void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) override;
  std::string reset() override;
  void describe(StageState* state, diagnostic_updater::DiagnosticStatusWrapper& values) override;

  void onImage(const sensor_msgs::ImageConstPtr& image);
  /// Posts a task that processes the oldest stored image, unless one is pending or none can run.
  void scheduleProcessing();
  void processOldest();
  void process(const GreyImage& image, bool clock_jumped_back);
  /// Starts the odometry anew if this image does not continue the ones before it: its sequence and
  /// map ids are 0 again.
  void startOdometry(const GreyImage& image, bool clock_jumped_back);
  void publish(const SelfCalibratingOdometry::Output& output, const std_msgs::Header& header);
  void publishLens(const std_msgs::Header& header);
  std::string saveCamera() const;

  MonoVoParams params_;
  std::unique_ptr<ImageReceiver> receiver_;
  std::deque<sensor_msgs::ImageConstPtr> images_;
  std::uint64_t dropped_from_queue_ = 0;
  bool processing_scheduled_ = false;
  std::unique_ptr<StampFilter> stamp_filter_;

  std::unique_ptr<SelfCalibratingOdometry> odometry_;  ///< null: the next image starts one
  std::shared_ptr<const CameraCalibration> odometry_camera_;
  TrackPainter painter_;
  std::optional<VoFrame> last_frame_;  ///< of odometry_

  ros::Publisher frame_publisher_, image_publisher_, mask_publisher_, odometry_publisher_,
      points_publisher_, refined_camera_publisher_;
  image_transport::Publisher tracks_publisher_;
};

void MonoVoNodelet::start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  params_ = loadParams<MonoVoParams>(private_handle);
  stamp_filter_ = std::make_unique<StampFilter>(
      params_.clock_jump_s,
      [this](const std::string& reason) { log_->drop("image stamp", withMissingClock(reason)); });
  receiver_ = std::make_unique<ImageReceiver>(
      handle, private_handle, params_, log_.get(),
      [this](const sensor_msgs::ImageConstPtr& image) { onImage(image); },
      [this] { scheduleProcessing(); });
  if (!params_.readout_time_is_given && receiver_->camera()) {
    params_.odometry.vo.readout_time = receiver_->camera()->readout_time;
  }
  frame_publisher_ = handle.advertise<VoFrameMsg>("vo/frame", kPublishQueue);
  image_publisher_ = handle.advertise<sensor_msgs::Image>("vo/image", kPublishQueue);
  mask_publisher_ = handle.advertise<sensor_msgs::Image>("vo/mask", 1, true);
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("vo/odometry", kPublishQueue);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("vo/points", 1);
  tracks_publisher_ = receiver_->transport().advertise("vo/image_tracks", 1);
  if (!params_.odometry.refine_camera) return;
  refined_camera_publisher_ =
      handle.advertise<sensor_msgs::CameraInfo>("refined_camera_info", 1, true);
  advertise(private_handle, "save_camera", [this] { return saveCamera(); });
}

std::string MonoVoNodelet::reset() {
  odometry_.reset();
  last_frame_.reset();
  return "the next image starts a new map";
}

std::string MonoVoNodelet::saveCamera() const {
  if (params_.refined_camera_file.empty()) {
    throw DataError("the parameter refined_camera_file names no file");
  }
  if (!odometry_ || !odometry_->lens().isEstimate()) {
    throw DataError("the calibration is not refined yet: the camera has not turned enough");
  }
  if (!odometry_camera_->hasLens()) {
    throw DataError(
        "the refined calibration is that of the rectified images, as the distortion of the raw "
        "ones is not plumb_bob: it cannot be saved");
  }
  CameraCalibration refined = calibrationOf(odometry_->lens().lens);
  refined.readout_time = params_.odometry.vo.readout_time;
  writeFile(params_.refined_camera_file, cameraYaml(refined, "Refined by MonoVo while driving."));
  return "written to " + params_.refined_camera_file;
}

void MonoVoNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  if (images_.size() == static_cast<std::size_t>(params_.queue_size)) {
    images_.pop_front();
    ++dropped_from_queue_;
  }
  images_.push_back(image);
  scheduleProcessing();
}

void MonoVoNodelet::scheduleProcessing() {
  if (processing_scheduled_ || images_.empty() || !receiver_->camera()) return;
  processing_scheduled_ = true;
  post([this] {
    processing_scheduled_ = false;
    try {
      processOldest();
    } catch (const std::exception& error) {
      log_->drop("image failed", error.what());
    }
    scheduleProcessing();
  });
}

void MonoVoNodelet::processOldest() {
  const sensor_msgs::ImageConstPtr image = images_.front();
  images_.pop_front();
  const GreyImage grey{image, receiver_->grey(*image), receiver_->camera()};
  if (grey.grey.empty()) return;
  stamp_filter_->add(toNanoseconds(image->header.stamp), [=](bool clock_jumped_back) {
    const Stopwatch watch;  // an image may have been held since it arrived
    process(grey, clock_jumped_back);
    countFrame(watch);
  });
}

void MonoVoNodelet::process(const GreyImage& image, bool clock_jumped_back) {
  std_msgs::Header header = image.message->header;
  header.frame_id = tfFrame(header.frame_id, "frame_id of the images");
  startOdometry(image, clock_jumped_back);
  const SelfCalibratingOdometry::Output output =
      odometry_->process(image.grey, toNanoseconds(header.stamp));
  publish(output, header);
  last_frame_ = output.frame;
}

void MonoVoNodelet::startOdometry(const GreyImage& image, bool clock_jumped_back) {
  std::string reason;
  if (clock_jumped_back) {
    reason = "the clock jumped back";
  } else if (image.camera != odometry_camera_ && odometry_camera_) {
    reason = "camera_info on topic " + receiver_->cameraInfoTopic() + " changed from " +
             odometry_camera_->describe() + " to " + image.camera->describe();
  }
  if (odometry_ && reason.empty()) return;
  if (odometry_) NODELET_WARN_STREAM(getName() << ": the odometry is reset: " << reason);
  reset();
  odometry_ =
      std::make_unique<SelfCalibratingOdometry>(*image.camera, params_.odometry, receiver_->mask());
  odometry_camera_ = image.camera;
  painter_ = TrackPainter();
}

void MonoVoNodelet::publish(const SelfCalibratingOdometry::Output& output,
                            const std_msgs::Header& header) {
  const VoFrame& frame = output.frame;
  const bool has_other_lens = frame.continuity == Continuity::kOtherLens;
  if (!last_frame_ || has_other_lens) {
    cv::Mat mask = output.image.mask;
    if (mask.empty()) mask = cv::Mat(output.image.grey.size(), CV_8U, cv::Scalar(255));
    mask_publisher_.publish(toMsg(mask, sensor_msgs::image_encodings::MONO8, header));
  }
  // Before vo/frame: a subscriber of all three that gets them in order waits for none.
  if (image_publisher_.getNumSubscribers() > 0) {
    image_publisher_.publish(toMsg(output.image.grey, sensor_msgs::image_encodings::MONO8, header));
  }
  frame_publisher_.publish(toMsg(frame, header));
  if (frame.status == VoStatus::kTracking) {
    odometry_publisher_.publish(toOdometryMsg(frame, header, params_.world_frame));
  }
  if (points_publisher_.getNumSubscribers() > 0) {
    points_publisher_.publish(toPointCloud(frame, header));
  }
  if (tracks_publisher_.getNumSubscribers() > 0) {
    tracks_publisher_.publish(painter_.paint(output.image, frame, output.rejected, header));
  }
  if (has_other_lens) publishLens(header);
}

/// The calibration of the images as they come, or of the rectified ones when their distortion is
/// not plumb_bob.
void MonoVoNodelet::publishLens(const std_msgs::Header& header) {
  const Lens& lens = odometry_->lens().lens;
  const auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(calibrationOf(lens)));
  info->header = header;
  refined_camera_publisher_.publish(sensor_msgs::CameraInfoConstPtr(info));
  NODELET_INFO_STREAM(getName() << ": the camera is refined: f " << lens.camera.fx << ", cx "
                                << lens.camera.cx << ", cy " << lens.camera.cy << ", k1 " << lens.k1
                                << " (standard deviation " << odometry_->lens().sigmas()[3]
                                << "), k2 " << lens.k2);
}

void MonoVoNodelet::describe(StageState* state,
                             diagnostic_updater::DiagnosticStatusWrapper& values) {
  receiver_->describe(state);
  state->input = "image";
  state->inputs = "images";
  state->dropped = dropped_from_queue_ + log_->dropped("image ");
  state->stage = summarize(last_frame_ ? std::optional(last_frame_->status) : std::nullopt);
  const VoFrame frame = last_frame_.value_or(VoFrame());
  values.add("images received", receiver_->received());
  values.add("images processed", processed());
  values.add("images dropped, queue full", dropped_from_queue_);
  values.add("map_id", frame.map_id);
  values.add("features", frame.features.size());
  values.add("map points", std::count_if(frame.features.begin(), frame.features.end(),
                                         [](const TrackedFeature& f) { return f.has_point; }));
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::MonoVoNodelet, nodelet::Nodelet)
