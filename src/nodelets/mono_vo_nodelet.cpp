#include "ground_scale_vo/nodelets/mono_vo_nodelet.hpp"

#include <nav_msgs/Odometry.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <exception>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/files.hpp"
#include "ground_scale_vo/common/time.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/nodelets/load_params.hpp"
#include "ground_scale_vo/nodelets/topic_rates.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/diagnostic_summary.hpp"
#include "ground_scale_vo/ros/frame_name.hpp"
#include "ground_scale_vo/ros/image_message.hpp"
#include "ground_scale_vo/ros/missing_clock.hpp"
#include "ground_scale_vo/ros/odometry_message.hpp"

namespace ground_scale_vo {

MonoVoNodelet::~MonoVoNodelet() { callbacks_.stop(); }

void MonoVoNodelet::onInit() {
  startNodelet(getName(), [this] { start(); });
}

void MonoVoNodelet::start() {
  ros::NodeHandle handle = callbacks_.handle(getNodeHandle());
  ros::NodeHandle private_handle = callbacks_.handle(getPrivateNodeHandle());
  params_ = loadParams<MonoVoParams>(getName(), private_handle);
  stamp_filter_ = std::make_unique<StampFilter<RectifiedImage>>(
      params_.clock_jump_s,
      [this](const std::string& reason) { drop("image stamp", withMissingClock(reason)); });
  images_ = std::make_unique<BoundedQueue<sensor_msgs::ImageConstPtr>>(
      static_cast<std::size_t>(params_.queue_size));

  ImageReceiver::Options options;
  options.image_is_rectified = params_.image_is_rectified;
  options.mask_file = params_.mask;
  options.camera_file = params_.camera_file;
  options.image_transport = params_.image_transport;
  ImageReceiver::Handlers handlers;
  handlers.on_image = [this](const sensor_msgs::ImageConstPtr& image) { onImage(image); };
  handlers.on_camera = [this] { scheduleProcessing(); };
  handlers.on_drop = [this](const std::string& kind, const std::string& reason) {
    drop(kind, reason);
  };
  handlers.on_warning = [this](const std::string& sentence) {
    NODELET_WARN_STREAM(getName() << ": " << sentence);
  };
  handlers.on_error = [this](const std::string& sentence) {
    NODELET_ERROR_STREAM(getName() << ": " << sentence);
  };
  receiver_ = std::make_unique<ImageReceiver>(handle, private_handle, options, handlers);
  if (!params_.readout_time_is_given) params_.odometry.vo.readout_time = receiver_->readoutTime();
  advertise(handle, private_handle);
  callbacks_.start();
}

void MonoVoNodelet::advertise(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  frame_publisher_ = handle.advertise<VoFrameMsg>("vo/frame", kPublishQueue);
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("vo/odometry", kPublishQueue);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("vo/points", 1);
  tracks_publisher_ = receiver_->transport().advertise("vo/image_tracks", 1);
  if (params_.odometry.refine_camera) {
    refined_camera_publisher_ =
        handle.advertise<sensor_msgs::CameraInfo>("refined_camera_info", 1, true);
    save_camera_server_ =
        private_handle.advertiseService("save_camera", &MonoVoNodelet::onSaveCamera, this);
  }
  reset_server_ = private_handle.advertiseService("reset", &MonoVoNodelet::onReset, this);

  updater_ = std::make_unique<diagnostic_updater::Updater>(handle, private_handle, getName());
  updater_->setHardwareID("none");
  updater_->add("odometry", this, &MonoVoNodelet::diagnose);
  diagnostics_timer_ =
      handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                             [this](const ros::WallTimerEvent&) { updater_->force_update(); });
}

bool MonoVoNodelet::onReset(std_srvs::Trigger::Request& /*request*/,
                            std_srvs::Trigger::Response& response) {
  odometry_.reset();
  status_.reset();
  map_id_ = 0;
  features_ = points_ = 0;
  response.success = true;
  response.message = "reset: the next image starts a new map";
  return true;
}

bool MonoVoNodelet::onSaveCamera(std_srvs::Trigger::Request& /*request*/,
                                 std_srvs::Trigger::Response& response) {
  response.success = false;
  if (params_.refined_camera_file.empty()) {
    response.message = "the parameter refined_camera_file names no file";
  } else if (!odometry_ || !odometry_->lens().isEstimate()) {
    response.message = "the calibration is not refined yet: the camera has not turned enough";
  } else if (odometry_camera_->isGivenRectified()) {
    response.message =
        "the refined calibration is that of the rectified images, as the distortion "
        "of the raw ones is not plumb_bob: it cannot be saved";
  } else {
    try {
      CameraCalibration refined = calibrationOf(odometry_->lens().lens);
      refined.readout_time = params_.odometry.vo.readout_time;
      writeFile(params_.refined_camera_file,
                cameraYaml(refined, "Refined by MonoVo while driving."));
      response.success = true;
      response.message = "written to " + params_.refined_camera_file;
    } catch (const DataError& error) {
      response.message = error.what();
    }
  }
  return true;
}

void MonoVoNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  if (!images_->push(image)) ++dropped_from_queue_;
  scheduleProcessing();
}

void MonoVoNodelet::scheduleProcessing() {
  if (processing_scheduled_ || images_->empty() || !receiver_->camera()) return;
  processing_scheduled_ = true;
  callbacks_.post([this] {
    processing_scheduled_ = false;
    try {
      rectify(*images_->pop());
    } catch (const std::exception& error) {
      drop("image failed", error.what());
    }
    scheduleProcessing();
  });
}

void MonoVoNodelet::rectify(const sensor_msgs::ImageConstPtr& image) {
  const Stopwatch watch;
  const bool refine = params_.odometry.refine_camera;
  const cv::Mat grey = refine ? receiver_->given(*image) : receiver_->rectify(*image);
  if (grey.empty()) return;
  const RectifiedImage rectified{image, grey, receiver_->camera(),
                                 refine ? receiver_->givenMask() : receiver_->mask()};
  for (const auto& accepted :
       stamp_filter_->filter(toNanoseconds(image->header.stamp), rectified)) {
    process(accepted.message, accepted.clock_jumped_back);
    frame_ms_ = watch.ms();
  }
}

void MonoVoNodelet::process(const RectifiedImage& image, bool clock_jumped_back) {
  std_msgs::Header header = image.message->header;
  header.frame_id =
      frameName(header.frame_id, "frame_id of the images", [this](const std::string& sentence) {
        if (!std::exchange(has_warned_of_slash_, true)) {
          NODELET_WARN_STREAM(getName() << ": " << sentence);
        }
      });
  prepareOdometry(image, clock_jumped_back);
  const SelfCalibratingOdometry::Output output =
      odometry_->process(image.grey, toNanoseconds(header.stamp));
  publish(output, header);
  if (output.lens_changed) publishLens(header);

  ++processed_;
  since_processed_.emplace();
  status_ = output.frame.status;
  map_id_ = output.frame.map_id;
  features_ = output.frame.features.size();
  points_ = static_cast<std::size_t>(
      std::count_if(output.frame.features.begin(), output.frame.features.end(),
                    [](const TrackedFeature& feature) { return feature.has_point; }));
}

void MonoVoNodelet::prepareOdometry(const RectifiedImage& image, bool clock_jumped_back) {
  const std::shared_ptr<const CalibratedCamera>& camera = image.camera;
  if (odometry_) {
    if (clock_jumped_back) NODELET_WARN("The clock jumped back: the odometry is reset.");
    if (camera != odometry_camera_) {
      NODELET_WARN_STREAM("The odometry is reset: camera_info on topic "
                          << receiver_->cameraInfoTopic() << " changed from "
                          << odometry_camera_->calibration().describe() << " to "
                          << camera->calibration().describe());
    }
    if (!clock_jumped_back && camera == odometry_camera_) return;
  }
  const Lens lens =
      params_.odometry.refine_camera ? lensOf(camera->givenCalibration()) : Lens{camera->camera()};
  odometry_ = std::make_unique<SelfCalibratingOdometry>(lens, params_.odometry, image.mask);
  odometry_camera_ = camera;
  painter_ = TrackPainter();
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
        painter_.paint(output.image, frame, output.rejected, header, output.mask));
  }
}

/// The calibration of the images as they come, or of the rectified ones when their distortion is
/// not plumb_bob.
void MonoVoNodelet::publishLens(const std_msgs::Header& header) {
  const Lens& lens = odometry_->lens().lens;
  const auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(calibrationOf(lens)));
  info->header = header;
  refined_camera_publisher_.publish(sensor_msgs::CameraInfoConstPtr(info));
  const LensVector sigmas = odometry_->lens().sigmas();
  NODELET_INFO_STREAM(getName() << ": the camera is refined: f " << lens.camera.fx << ", cx "
                                << lens.camera.cx << ", cy " << lens.camera.cy << ", k1 " << lens.k1
                                << " (standard deviation " << sigmas[3] << "), k2 " << lens.k2);
}

void MonoVoNodelet::drop(const std::string& kind, const std::string& reason) {
  const std::string sentence = warnings_.count(kind, reason);
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

void MonoVoNodelet::warnOfMissingInput(const MonoVoState& state) {
  const std::string sentence = missing_input_log_.due(missingInput(state), ros::Time::now());
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

void MonoVoNodelet::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::uint64_t dropped = dropped_from_queue_ + warnings_.total("image ");
  MonoVoState state;
  state.images.topic = receiver_->imageTopic();
  state.images.silent_s = receiver_->secondsSinceImage();
  if (since_processed_) state.images.unused_s = since_processed_->seconds();
  state.images.dropped = dropped - dropped_at_last_diagnosis_;
  state.images.clock_error = missingClock();
  state.camera_info_topic = receiver_->cameraInfoTopic();
  state.camera_known = receiver_->camera() != nullptr;
  state.camera_info_error = receiver_->cameraInfoError();
  state.source_error = receiver_->sourceError();
  state.rectification_warning = receiver_->rectificationWarning();
  state.status = status_;
  dropped_at_last_diagnosis_ = dropped;

  warnOfMissingInput(state);
  const DiagnosticSummary summary = summarize(state);
  status.summary(static_cast<std::uint8_t>(summary.level), summary.message);
  status.add("rate [Hz]", rate_.rate(processed_));
  status.add("time of the last frame [ms]", frame_ms_);
  status.add("images received", receiver_->imagesReceived());
  status.add("images processed", processed_);
  status.add("images dropped, queue full", dropped_from_queue_);
  for (const auto& [kind, count] : warnings_.counts()) status.add("dropped: " + kind, count);
  status.add("map_id", map_id_);
  status.add("features", features_);
  status.add("map points", points_);
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::MonoVoNodelet, nodelet::Nodelet)
