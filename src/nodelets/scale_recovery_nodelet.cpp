#include "ground_scale_vo/nodelets/scale_recovery_nodelet.hpp"

#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/Marker.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/visuals.hpp"

namespace ground_scale_vo {
namespace {

/// [images] that may wait for their frame, at least: one second of a 30 Hz camera.
constexpr int kMinImageBuffer = 30;
/// [images] beyond queue_size: with the same queue_size and a full queue, MonoVo is late by those
/// that arrive while it processes one, too.
constexpr int kImageMargin = 10;
constexpr std::uint32_t kSpeedQueue = 1000;  // [speeds] ten seconds at 100 Hz
constexpr double kWaitingPeriod = 0.1;       // [s] wall time, between checks of waiting frames

std::uint32_t imageBuffer(const ScaleRecoveryParams& params) {
  return static_cast<std::uint32_t>(std::max(kMinImageBuffer, params.queue_size + kImageMargin));
}

}  // namespace

void ScaleRecoveryNodelet::start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  params_ = loadParams<ScaleRecoveryParams>(private_handle);
  recovery_ = std::make_unique<ScaleRecovery>(params_.scale);
  stamp_filter_ = std::make_unique<StampFilter<ReceivedFrame>>(
      params_.images.clock_jump_s,
      [this](const std::string& reason) { log_->drop("frame stamp", withMissingClock(reason)); });
  Synchronizer::Limits limits;
  limits.images = imageBuffer(params_);
  synchronizer_ = std::make_unique<Synchronizer>(limits);

  odometry_ = std::make_unique<OdometryOutput>(handle, params_, log_.get());
  scale_publisher_ = handle.advertise<ScaleEstimateMsg>("scale", kPublishQueue);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("points", 1);
  ground_points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("ground_points", 1);
  ground_plane_publisher_ = handle.advertise<visualization_msgs::Marker>("ground_plane", 1);
  if (params_.scale.refine) subscribeToImages(handle, private_handle);
  if (params_.scale.use_speed) {
    speed_subscriber_ =
        handle.subscribe("speed", kSpeedQueue, &ScaleRecoveryNodelet::onSpeed, this);
    advertise(private_handle, "save_height", [this] { return saveHeight(); });
  }
  // Last: a publisher that sees this subscription can rely on the subscription to the images.
  frame_subscriber_ = handle.subscribe("vo/frame", static_cast<std::uint32_t>(params_.queue_size),
                                       &ScaleRecoveryNodelet::onFrame, this);
}

void ScaleRecoveryNodelet::subscribeToImages(ros::NodeHandle& handle,
                                             ros::NodeHandle& private_handle) {
  receiver_ = std::make_unique<ImageReceiver>(
      handle, private_handle, params_.images, imageBuffer(params_), log_.get(),
      [this](const sensor_msgs::ImageConstPtr& image) { onImage(image); });
  road_publisher_ = receiver_->transport().advertise("image_road", 1);
  waiting_timer_ = handle.createWallTimer(ros::WallDuration(kWaitingPeriod),
                                          [this](const ros::WallTimerEvent&) { processReady(); });
}

std::string ScaleRecoveryNodelet::reset() {
  processReady(false);
  continuity_.startTrajectory();
  restart(true);
  return "scale unknown, the next metric pose is zero";
}

void ScaleRecoveryNodelet::restart(bool first_pose_is_zero) {
  recovery_->reset();
  odometry_->restart(first_pose_is_zero);
  report_ = Report();
}

void ScaleRecoveryNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  synchronizer_->addImage(toNanoseconds(image->header.stamp), image);
  processReady();
}

void ScaleRecoveryNodelet::onFrame(const VoFrameMsg::ConstPtr& msg) {
  frames_.count();
  continuity_.receive(msg->sequence);
  if (!continuity_.sequenceError().empty()) log_->warn("sequence", continuity_.sequenceError());
  ReceivedFrame received{{}, msg->header};
  const std::string slash = leadingSlashWarning(msg->header.frame_id, "frame_id of vo/frame");
  if (!slash.empty()) log_->warn("frame_id", slash);
  received.header.frame_id = withoutLeadingSlashes(msg->header.frame_id);
  try {
    received.frame = fromMsg(*msg);
  } catch (const MessageError& error) {
    log_->drop("frame refused", error.what());
    return;
  }
  for (auto& [frame, clock_jumped_back] :
       stamp_filter_->filter(toNanoseconds(msg->header.stamp), std::move(received))) {
    const std::int64_t stamp_ns = frame.frame.stamp_ns;
    const std::string reason =
        continuity_.next(frame.frame, frame.header.frame_id, clock_jumped_back);
    if (!reason.empty()) {
      NODELET_WARN_STREAM(getName() << ": scale and odometry are reset: " << reason);
      processReady(false);
      if (clock_jumped_back) synchronizer_->jumpBack(stamp_ns);
      restart(!clock_jumped_back);
    }
    synchronizer_->addFrame(stamp_ns, std::move(frame), Synchronizer::Clock::now());
  }
  processReady();
}

void ScaleRecoveryNodelet::onSpeed(const topic_tools::ShapeShifter::ConstPtr& message) {
  speeds_.count();
  speed_error_.clear();
  try {
    const SpeedSample speed = speed_reader_.read(*message);
    recovery_->addSpeed(speed);
    newest_speed_ns_ = speed.stamp_ns;
  } catch (const MessageError& error) {
    speed_error_ = "speed on " + speed_subscriber_.getTopic() + " " + error.what();
    if (dynamic_cast<const SpeedTypeError*>(&error) != nullptr) {
      log_->error("speed type", speed_error_);
    } else {
      log_->drop("speed refused", withMissingClock(speed_error_));
    }
  }
}

void ScaleRecoveryNodelet::processReady(bool may_wait) {
  while (const auto match = synchronizer_->next(Synchronizer::Clock::now(), may_wait)) {
    process(match->frame.frame, match->frame.header, match->image);
  }
}

void ScaleRecoveryNodelet::process(const VoFrame& frame, const std_msgs::Header& header,
                                   const sensor_msgs::ImageConstPtr& message) {
  const Stopwatch watch;
  const CameraImage image = message ? receiver_->imageOf(frame, *message) : CameraImage();
  ScaleRecovery::Output output;
  try {
    output = recovery_->process(frame, image.grey, image.mask);
  } catch (const std::exception& error) {
    log_->drop("frame failed", error.what());
    return;
  }
  publish(output, frame, image, header);
  check(output, frame);
  record(std::move(output), frame.stamp_ns, !image.grey.empty());
  countFrame(watch);
}

void ScaleRecoveryNodelet::publish(const ScaleRecovery::Output& output, const VoFrame& frame,
                                   const CameraImage& image, const std_msgs::Header& header) {
  scale_publisher_.publish(toMsg(output.scale, frame.map_id, header));
  odometry_->publish(output.pose, header);
  if (output.scale.status != ScaleStatus::kUnknown) publishGround(output, frame, header);
  if (road_publisher_.getNumSubscribers() > 0 && !image.grey.empty()) {
    road_publisher_.publish(paintRoad(image.grey, frame, output, header, image.mask));
  }
}

void ScaleRecoveryNodelet::publishGround(const ScaleRecovery::Output& output, const VoFrame& frame,
                                         const std_msgs::Header& header) {
  if (points_publisher_.getNumSubscribers() > 0) {
    points_publisher_.publish(toPointCloud(frame, header, output.scale.scale));
  }
  if (ground_points_publisher_.getNumSubscribers() > 0) {
    std::vector<Eigen::Vector3f> metric = output.ground_points_c;
    for (Eigen::Vector3f& point : metric) point *= static_cast<float>(output.scale.scale);
    ground_points_publisher_.publish(toPointCloud(metric, header));
  }
  if (ground_plane_publisher_.getNumSubscribers() > 0 && hasGroundPlane(output.scale)) {
    ground_plane_publisher_.publish(toPlaneMarker(output.scale, header));
  }
}

void ScaleRecoveryNodelet::check(const ScaleRecovery::Output& output, const VoFrame& frame) {
  if (frame.status == VoStatus::kTracking) {
    report_.turn_axis.add(frame.map_id, frame.T_w_c.linear());
  }
  std::optional<MountingOnTf> on_tf;
  const auto& frames = odometry_->frames();
  if (frames && frames->base_frame != continuity_.cameraFrame() && !params_.moving_mount) {
    on_tf = MountingOnTf{frames->base_frame, continuity_.cameraFrame(),
                         frames->T_c_b.linear() * Eigen::Vector3d::UnitZ()};
  }
  report_.warnings = {mountingWarning(output, report_.turn_axis.upward(), on_tf),
                      output.speed_warning};
  if (params_.scale.use_speed && !newest_speed_ns_) {
    report_.warnings.back() =
        speed_error_.empty() ? "no speed received yet on " + speed_subscriber_.getTopic() : "";
  }
  if (!speed_reader_.hasVehicleAxes()) {
    report_.warnings.push_back("the velocity on " + speed_subscriber_.getTopic() +
                               " is not along x, so its length without a sign is used");
  }
  for (const std::string& warning : report_.warnings) {
    // Its numbers change from frame to frame.
    std::string kind;
    std::remove_copy_if(warning.begin(), warning.end(), std::back_inserter(kind),
                        [](char c) { return c >= '-' && c <= '9'; });
    if (kind.empty() || !report_.logged.insert(kind).second) continue;
    NODELET_WARN_STREAM(getName() << ": " << warning);
  }
}

void ScaleRecoveryNodelet::record(ScaleRecovery::Output output, std::int64_t stamp_ns,
                                  bool has_image) {
  last_frame_had_image_ = has_image;
  if (has_image) ++with_image_;
  if (output.direct.height > 0) ++with_direct_;
  report_.stamp_ns = stamp_ns;
  if (output.scale.status == ScaleStatus::kOk) report_.measured_ns = stamp_ns;
  if (output.scale.status != ScaleStatus::kHeld ||
      output.scale.measurement == MeasurementStatus::kStandstill) {
    report_.held_since_ns.reset();
  } else if (!report_.held_since_ns) {
    report_.held_since_ns = stamp_ns;
  }
  if (output.pose) report_.distance_m = output.pose->distance;
  report_.last = std::move(output);
}

std::string ScaleRecoveryNodelet::saveHeight() const {
  if (params_.height_file.empty()) throw DataError("the parameter height_file names no file");
  const bool is_given = params_.scale.camera_height > 0;
  writeFile(params_.height_file,
            learnedHeightYaml(report_.last, is_given ? params_.scale.camera_height_sigma : 0));
  return "written to " + params_.height_file;
}

std::string ScaleRecoveryNodelet::imageState() const {
  if (!receiver_) return "not used";
  if (!receiver_->hasImagePublisher()) return "no publisher on " + receiver_->imageTopic();
  if (!receiver_->camera()) {
    return "no valid camera_info received yet on " + receiver_->cameraInfoTopic();
  }
  return last_frame_had_image_ ? "used" : "no image of the last frame";
}

void ScaleRecoveryNodelet::describe(StageState* state) {
  state->input = "vo/frame";
  state->inputs = "frames";
  state->dropped = continuity_.missing() + log_->dropped("frame ");
  state->missing = frames_.missing(frame_subscriber_.getTopic());
  state->errors = {odometry_->mountingError(), odometry_->otherParentError(),
                   receiver_ ? receiver_->sourceError() : "", speed_error_};
  state->warnings = report_.warnings;
  state->warnings.push_back(continuity_.sequenceError());
  const bool has_frames = processed() > std::exchange(diagnosed_processed_, processed());
  const bool has_images = with_image_ > std::exchange(diagnosed_with_image_, with_image_);
  state->stage = summarize(
      report_.last.scale,
      report_.held_since_ns ? secondsBetween(*report_.held_since_ns, report_.stamp_ns) : 0,
      receiver_ && has_frames && !has_images ? imageState() : "");
}

void ScaleRecoveryNodelet::addValues(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const ScaleEstimate& scale = report_.last.scale;
  status.add("frames processed", processed());
  status.add("frames dropped, queue full", continuity_.missing());
  status.add("images", imageState());
  status.add("frames without an image", processed() - with_image_);
  status.add("frames with a direct measurement", with_direct_);
  status.add("scale status", toString(scale.status));
  status.add("reason", toString(scale.measurement));
  status.add("source", toString(scale.source));
  status.add("scale [m / VO unit]", scale.scale);
  status.add("sigma [m / VO unit]", scale.sigma);
  if (report_.measured_ns) {
    status.add("age of the last measurement [s]",
               secondsBetween(*report_.measured_ns, report_.stamp_ns));
  }
  status.add("distance [m]", report_.distance_m);
  status.add("camera height [m]", scale.camera_height);
  status.add("sigma of the camera height [m]", scale.camera_height_sigma);
  if (!params_.scale.use_speed) return;
  status.add("speeds received", speeds_.received());
  if (newest_speed_ns_) {
    status.add("age of the newest speed [s]", secondsBetween(*newest_speed_ns_, report_.stamp_ns));
  }
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::ScaleRecoveryNodelet, nodelet::Nodelet)
