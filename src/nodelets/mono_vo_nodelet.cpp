#include "ground_scale_vo/nodelets/mono_vo_nodelet.hpp"

#include <nav_msgs/Odometry.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <exception>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "common/files.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/ros/odometry_output.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kImageQueue = 100;  // [images] that wait for their callback

}  // namespace

void MonoVoNodelet::start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  params_ = loadParams<MonoVoParams>(private_handle);
  stamp_filter_ = std::make_unique<StampFilter<GreyImage>>(
      params_.images.clock_jump_s,
      [this](const std::string& reason) { log_->drop("image stamp", withMissingClock(reason)); });
  receiver_ = std::make_unique<ImageReceiver>(
      handle, private_handle, params_.images, kImageQueue, log_.get(),
      [this](const sensor_msgs::ImageConstPtr& image) { onImage(image); },
      [this] { scheduleProcessing(); });
  if (!params_.readout_time_is_given && receiver_->camera()) {
    params_.odometry.vo.readout_time = receiver_->camera()->readout_time;
  }
  frame_publisher_ = handle.advertise<VoFrameMsg>("vo/frame", kPublishQueue);
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
    const sensor_msgs::ImageConstPtr image = images_.front();
    images_.pop_front();
    try {
      convert(image);
    } catch (const std::exception& error) {
      log_->drop("image failed", error.what());
    }
    scheduleProcessing();
  });
}

void MonoVoNodelet::convert(const sensor_msgs::ImageConstPtr& image) {
  const Stopwatch watch;
  const cv::Mat grey = receiver_->toGrey(*image);
  if (grey.empty()) return;
  for (const auto& accepted : stamp_filter_->filter(toNanoseconds(image->header.stamp),
                                                    {image, grey, receiver_->camera()})) {
    process(accepted.message, accepted.clock_jumped_back);
    countFrame(watch);
  }
}

void MonoVoNodelet::process(const GreyImage& image, bool clock_jumped_back) {
  std_msgs::Header header = image.message->header;
  const std::string slash = leadingSlashWarning(header.frame_id, "frame_id of the images");
  if (!slash.empty()) log_->warn("frame_id", slash);
  header.frame_id = withoutLeadingSlashes(header.frame_id);

  const std::string reason = restartReason(image, clock_jumped_back);
  if (!reason.empty()) {
    NODELET_WARN_STREAM(getName() << ": the odometry is reset: " << reason);
    reset();
  }
  if (!odometry_) {
    odometry_ = std::make_unique<SelfCalibratingOdometry>(*image.camera, params_.odometry,
                                                          receiver_->mask());
    odometry_camera_ = image.camera;
    painter_ = TrackPainter();
  }
  const SelfCalibratingOdometry::Output output =
      odometry_->process(image.grey, toNanoseconds(header.stamp));
  publish(output, header);
  if (output.frame.continuity == Continuity::kOtherLens) publishLens(header);
  last_frame_ = output.frame;
}

std::string MonoVoNodelet::restartReason(const GreyImage& image, bool clock_jumped_back) const {
  if (!odometry_) return {};
  if (clock_jumped_back) return "the clock jumped back";
  if (image.camera == odometry_camera_) return {};
  return "camera_info on topic " + receiver_->cameraInfoTopic() + " changed from " +
         odometry_camera_->describe() + " to " + image.camera->describe();
}

void MonoVoNodelet::publish(const SelfCalibratingOdometry::Output& output,
                            const std_msgs::Header& header) {
  const VoFrame& frame = output.frame;
  frame_publisher_.publish(toMsg(frame, header));
  if (frame.status == VoStatus::kTracking) {
    odometry_publisher_.publish(toOdometryMsg(frame, header, params_.world_frame));
  }
  if (points_publisher_.getNumSubscribers() > 0) {
    points_publisher_.publish(toPointCloud(frame, header));
  }
  if (tracks_publisher_.getNumSubscribers() > 0) {
    tracks_publisher_.publish(
        painter_.paint(output.image.grey, frame, output.rejected, header, output.image.mask));
  }
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

void MonoVoNodelet::describe(StageState* state) {
  state->input = "image";
  state->inputs = "images";
  state->dropped = dropped_from_queue_ + log_->dropped("image ");
  const std::string& info_error = receiver_->cameraInfoError();
  if (receiver_->camera() || info_error.empty()) {
    state->missing = receiver_->images().missing(receiver_->imageTopic());
    if (!state->missing) state->missing = receiver_->missingCameraInfo();
    state->errors = {receiver_->sourceError()};
    state->warnings = {info_error, receiver_->calibrationWarning()};
  } else {
    state->errors = {info_error};
  }
  state->stage = summarize(last_frame_ ? std::optional(last_frame_->status) : std::nullopt);
}

void MonoVoNodelet::addValues(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const VoFrame frame = last_frame_.value_or(VoFrame());
  status.add("images received", receiver_->images().received());
  status.add("images processed", processed());
  status.add("images dropped, queue full", dropped_from_queue_);
  status.add("map_id", frame.map_id);
  status.add("features", frame.features.size());
  status.add("map points", std::count_if(frame.features.begin(), frame.features.end(),
                                         [](const TrackedFeature& f) { return f.has_point; }));
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::MonoVoNodelet, nodelet::Nodelet)
