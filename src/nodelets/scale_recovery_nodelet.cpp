#include "ground_scale_vo/nodelets/scale_recovery_nodelet.hpp"

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/Marker.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <exception>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/seconds.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "ground_scale_vo/nodelets/load_params.hpp"
#include "ground_scale_vo/nodelets/topic_rates.hpp"
#include "ground_scale_vo/ros/diagnostic_summary.hpp"
#include "ground_scale_vo/ros/frame_name.hpp"
#include "ground_scale_vo/ros/missing_clock.hpp"
#include "ground_scale_vo/ros/mounting_check.hpp"
#include "ground_scale_vo/ros/visuals.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kTfQueue = 100;
/// [images] that may wait for their frame, at least: one second of a 30 Hz camera.
constexpr int kMinImageBuffer = 30;
/// [images] beyond queue_size: with the same queue_size and a full queue, MonoVo is late by those
/// that arrive while it processes one, too.
constexpr int kImageMargin = 10;
/// [ms] wall time to wait for tf with moving_mount, which may come later than the image.
constexpr double kMountingWaitMs = 200;
constexpr double kMountingPollMs = 2;
constexpr double kWaitingPeriod = 0.1;  // [s] wall time, between checks of waiting frames

double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return ground_scale_vo::secondsBetween(toNanoseconds(from), toNanoseconds(to));
}

std::uint32_t imageBuffer(const ScaleRecoveryParams& params) {
  return static_cast<std::uint32_t>(std::max(kMinImageBuffer, params.queue_size + kImageMargin));
}

}  // namespace

ScaleRecoveryNodelet::~ScaleRecoveryNodelet() { callbacks_.stop(); }

void ScaleRecoveryNodelet::onInit() {
  startNodelet(getName(), [this] { start(); });
}

void ScaleRecoveryNodelet::start() {
  ros::NodeHandle handle = callbacks_.handle(getNodeHandle());
  ros::NodeHandle private_handle = callbacks_.handle(getPrivateNodeHandle());
  params_ = loadParams<ScaleRecoveryParams>(getName(), private_handle);

  recovery_ = std::make_unique<ScaleRecovery>(params_.scale);
  stamp_filter_ = std::make_unique<StampFilter<ReceivedFrame>>(
      params_.clock_jump_s,
      [this](const std::string& reason) { drop("frame stamp", withMissingClock(reason)); });
  path_ = std::make_unique<BoundedPath>(static_cast<std::size_t>(params_.path_max_poses),
                                        params_.path_spacing_m);
  Synchronizer::Limits limits;
  limits.images = imageBuffer(params_);
  synchronizer_ = std::make_unique<Synchronizer>(limits);
  if (!params_.base_frame.empty()) {
    tf_buffer_ = std::make_unique<tf2_ros::Buffer>();
    tf_listener_ = std::make_unique<tf2_ros::TransformListener>(*tf_buffer_, handle);
  }
  if (params_.publish_tf) {
    tf_broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
    // The topics of tf2_ros.
    for (const bool is_static : {false, true}) {
      tf_subscribers_.push_back(handle.subscribe<tf2_msgs::TFMessage>(
          is_static ? "/tf_static" : "/tf", kTfQueue,
          [this, is_static](const tf2_msgs::TFMessageConstPtr& message) {
            frame_parents_.add(*message, is_static, FrameParents::Clock::now());
          }));
    }
  }

  advertise(handle, private_handle);
  if (params_.scale.refine) subscribeToImages(handle, private_handle);
  // Last: a publisher that sees this subscription can rely on the subscription to the images.
  frame_subscriber_ = handle.subscribe("vo/frame", static_cast<std::uint32_t>(params_.queue_size),
                                       &ScaleRecoveryNodelet::onFrame, this);
  callbacks_.start();
}

void ScaleRecoveryNodelet::advertise(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("odometry", kPublishQueue);
  scale_publisher_ = handle.advertise<ScaleEstimateMsg>("scale", kPublishQueue);
  // Latched. It is published only while it has subscribers, so the latched message may be old: each
  // new subscriber causes a new one.
  path_publisher_ = handle.advertise<nav_msgs::Path>(
      "path", 1, [this](const ros::SingleSubscriberPublisher&) { publishPath(); },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("points", 1);
  ground_points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("ground_points", 1);
  ground_plane_publisher_ = handle.advertise<visualization_msgs::Marker>("ground_plane", 2);
  reset_server_ = private_handle.advertiseService("reset", &ScaleRecoveryNodelet::onReset, this);

  updater_ = std::make_unique<diagnostic_updater::Updater>(handle, private_handle, getName());
  updater_->setHardwareID("none");
  updater_->add("scale", this, &ScaleRecoveryNodelet::diagnose);
  diagnostics_timer_ =
      handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                             [this](const ros::WallTimerEvent&) { updater_->force_update(); });
}

void ScaleRecoveryNodelet::subscribeToImages(ros::NodeHandle& handle,
                                             ros::NodeHandle& private_handle) {
  ImageReceiver::Options options;
  options.image_is_rectified = params_.image_is_rectified;
  options.mask_file = params_.mask;
  options.camera_file = params_.camera_file;
  options.image_transport = params_.image_transport;
  options.image_queue_size = imageBuffer(params_);
  ImageReceiver::Handlers handlers;
  handlers.on_image = [this](const sensor_msgs::ImageConstPtr& image) { onImage(image); };
  handlers.on_drop = [this](const std::string& kind, const std::string& reason) {
    drop(kind, reason);
  };
  handlers.on_warning = [this](const std::string& sentence) { warn("rectification", sentence); };
  handlers.on_error = [this](const std::string& sentence) {
    NODELET_ERROR_STREAM(getName() << ": " << sentence);
  };
  receiver_ = std::make_unique<ImageReceiver>(handle, private_handle, options, handlers);
  road_publisher_ = receiver_->transport().advertise("image_road", 1);
  waiting_timer_ = handle.createWallTimer(ros::WallDuration(kWaitingPeriod),
                                          [this](const ros::WallTimerEvent&) { processReady(); });
}

bool ScaleRecoveryNodelet::onReset(std_srvs::Trigger::Request& /*request*/,
                                   std_srvs::Trigger::Response& response) {
  startAtNextPose();
  response.success = true;
  response.message = "reset: scale unknown, the next metric pose is zero";
  return true;
}

void ScaleRecoveryNodelet::startAtNextPose() {
  processReady(false);
  reset();
  pose_origin_.moveToNextPose();
}

void ScaleRecoveryNodelet::reset() {
  recovery_->reset();
  map_numbering_.startTrajectory();
  pose_origin_.clear();
  odometry_frames_.reset();  // the mounting is looked up again
  mounting_error_.clear();
  mounting_warning_.clear();
  turn_axis_ = TurnAxis();
  has_warned_of_mounting_ = false;
  path_->clear();
  publishPath();
  last_scale_ = ScaleEstimate();
  last_measurement_ = held_since_ = ros::Time();
  distance_m_ = 0;
}

void ScaleRecoveryNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  synchronizer_->addImage(toNanoseconds(image->header.stamp), image);
  processReady();
}

void ScaleRecoveryNodelet::onFrame(const VoFrameMsg::ConstPtr& msg) {
  sequence_check_.add(msg->sequence);
  if (!sequence_check_.error().empty()) warn("sequence", sequence_check_.error());
  since_frame_.emplace();
  ReceivedFrame received;
  received.header = msg->header;
  received.header.frame_id =
      frameName(msg->header.frame_id, "frame_id of vo/frame",
                [this](const std::string& sentence) { warn("frame_id", sentence); });
  try {
    received.frame = fromMsg(*msg);
  } catch (const MessageError& error) {
    return drop("frame refused", error.what());
  }
  for (auto& accepted :
       stamp_filter_->filter(toNanoseconds(msg->header.stamp), std::move(received))) {
    const std::int64_t stamp_ns = accepted.message.frame.stamp_ns;
    if (accepted.clock_jumped_back) {
      NODELET_WARN("The clock jumped back: scale and odometry are reset.");
      processReady(false);
      synchronizer_->jumpBack(stamp_ns);
      reset();
      latest_clock_ = ros::Time();
    }
    resetForAnotherCamera(accepted.message.header.frame_id);
    synchronizer_->addFrame(stamp_ns, std::move(accepted.message), Synchronizer::Clock::now());
  }
  processReady();
}

void ScaleRecoveryNodelet::resetForAnotherCamera(const std::string& camera_frame) {
  if (camera_frame.empty()) return;
  if (!camera_frame_.empty() && camera_frame != camera_frame_) {
    NODELET_WARN_STREAM(getName() << ": scale and odometry are reset: the camera frame of "
                                  << frame_subscriber_.getTopic() << " changed from \""
                                  << camera_frame_ << "\" to \"" << camera_frame << "\"");
    startAtNextPose();
  }
  camera_frame_ = camera_frame;
}

void ScaleRecoveryNodelet::processReady(bool may_wait) {
  while (auto match = synchronizer_->next(Synchronizer::Clock::now(), may_wait)) {
    process(std::move(match->frame.frame), match->frame.header, match->image);
  }
}

ScaleRecoveryNodelet::FrameImage ScaleRecoveryNodelet::frameImage(
    const VoFrame& frame, const sensor_msgs::ImageConstPtr& image) {
  if (!image || !receiver_->camera()) return {};
  if (!frame.distortion.empty()) return refinedImage(frame, *image);
  if (receiver_->camera()->matches(frame.camera)) {
    const cv::Mat rectified = receiver_->rectify(*image);
    return {rectified, rectified.empty() ? cv::Mat() : receiver_->mask()};
  }
  const std::string source_error = receiver_->sourceError();
  drop("other camera", !source_error.empty()
                           ? source_error
                           : receiver_->cameraSource() + " describes another camera than " +
                                 frame_subscriber_.getTopic());
  return {};
}

/// Undistorted as by the odometry, which refines the camera.
ScaleRecoveryNodelet::FrameImage ScaleRecoveryNodelet::refinedImage(
    const VoFrame& frame, const sensor_msgs::Image& image) {
  CameraCalibration calibration = calibrationOf(Lens{frame.camera});
  std::copy(frame.distortion.begin(), frame.distortion.end(), calibration.distortion.begin());
  const cv::Mat given = receiver_->given(image);
  if (given.empty()) return {};
  if (!refined_ || refined_->given != receiver_->camera() ||
      !(refined_->calibration == calibration)) {
    const Undistortion undistortion(calibration);
    refined_.emplace(RefinedCamera{receiver_->camera(), calibration, undistortion,
                                   undistortion.mask(receiver_->givenMask())});
  }
  try {
    return {refined_->undistortion.image(given), refined_->mask};
  } catch (const DataError& error) {
    drop("other camera", error.what());
    return {};
  }
}

void ScaleRecoveryNodelet::process(VoFrame frame, const std_msgs::Header& header,
                                   const sensor_msgs::ImageConstPtr& image) {
  const Stopwatch watch;
  map_numbering_.apply(frame);
  const auto [rectified, mask] = frameImage(frame, image);
  ScaleRecovery::Output output;
  try {
    output = recovery_->process(frame, rectified, mask);
  } catch (const std::exception& error) {
    return drop("frame failed", error.what());
  }
  publish(output, frame, rectified, mask, header);
  if (frame.status == VoStatus::kTracking) turn_axis_.add(frame.map_id, frame.T_w_c.linear());
  checkMounting(output);
  record(output, header.stamp, !rectified.empty());
  frame_ms_ = watch.ms();
}

Eigen::Isometry3d ScaleRecoveryNodelet::lookUpMounting(const std_msgs::Header& header) {
  const ros::Time stamp = params_.moving_mount ? header.stamp : ros::Time(0);
  // In wall time: the timeout of tf2 never ends while the clock of a bag is stopped.
  const Stopwatch watch;
  while (params_.moving_mount && watch.ms() < kMountingWaitMs &&
         !tf_buffer_->canTransform(params_.base_frame, header.frame_id, stamp)) {
    ros::WallDuration(1e-3 * kMountingPollMs).sleep();
  }
  return fromMsg(tf_buffer_->lookupTransform(params_.base_frame, header.frame_id, stamp).transform);
}

const OdometryFrames* ScaleRecoveryNodelet::odometryFrames(const std_msgs::Header& header) {
  const std::string& camera_frame = header.frame_id;
  if (camera_frame.empty()) {
    mounting_error_ = "the frame_id of the images is empty: no metric pose is published";
    warn("no frame_id", mounting_error_);
    return nullptr;
  }
  if (odometry_frames_ && (!params_.moving_mount || mounting_stamp_ == header.stamp)) {
    return &*odometry_frames_;
  }
  if (params_.base_frame.empty() || params_.base_frame == camera_frame) {
    odometry_frames_ = OdometryFrames::ofCamera(params_.odom_frame, camera_frame);
  } else {
    try {
      const Eigen::Isometry3d T_b_c = lookUpMounting(header);
      if (odometry_frames_) {
        odometry_frames_->moveMounting(T_b_c, secondsBetween(mounting_stamp_, header.stamp));
      } else {
        odometry_frames_ = OdometryFrames::ofBase(params_.odom_frame, params_.base_frame, T_b_c);
      }
    } catch (const std::exception& error) {
      mounting_error_ = "no tf transform from base_frame \"" + params_.base_frame +
                        "\" to the camera frame \"" + camera_frame +
                        "\": no metric pose is published";
      const std::string sentence =
          other_warnings_.count("no tf", mounting_error_ + ": " + error.what());
      if (!sentence.empty()) NODELET_ERROR_STREAM(getName() << ": " << sentence);
      return nullptr;
    }
  }
  mounting_stamp_ = header.stamp;
  return &*odometry_frames_;
}

void ScaleRecoveryNodelet::checkMounting(const ScaleRecovery::Output& output) {
  mounting_warning_ = unsupportedMounting(output, turn_axis_.upward());
  const bool is_base = odometry_frames_ && odometry_frames_->base_frame != camera_frame_;
  if (mounting_warning_.empty() && is_base && !params_.moving_mount) {
    mounting_warning_ =
        wrongMountingOnTf(odometry_frames_->base_frame, camera_frame_,
                          odometry_frames_->T_c_b.linear() * Eigen::Vector3d::UnitZ(), output);
  }
  if (mounting_warning_.empty() || std::exchange(has_warned_of_mounting_, true)) return;
  NODELET_WARN_STREAM(getName() << ": " << mounting_warning_);
}

void ScaleRecoveryNodelet::publish(const ScaleRecovery::Output& output, const VoFrame& frame,
                                   const cv::Mat& rectified, const cv::Mat& mask,
                                   const std_msgs::Header& header) {
  scale_publisher_.publish(toMsg(output.scale, frame.map_id, header));
  mounting_error_.clear();
  // With a moving mount from the first image on: odom is the base at the origin.
  const OdometryFrames* const frames =
      params_.moving_mount || output.pose ? odometryFrames(header) : nullptr;
  if (output.scale.status != ScaleStatus::kUnknown) {
    if (output.pose && frames != nullptr) {
      publishPose(pose_origin_.relative(*output.pose), *frames, header.stamp);
    }
    publishGround(output, header);
    if (points_publisher_.getNumSubscribers() > 0) {
      points_publisher_.publish(toPointCloud(frame, header, output.scale.scale));
    }
  }
  if (road_publisher_.getNumSubscribers() > 0 && !rectified.empty()) {
    road_publisher_.publish(paintRoad(rectified, frame, output, header, mask));
  }
}

void ScaleRecoveryNodelet::publishPose(const MetricPose& pose, const OdometryFrames& frames,
                                       const ros::Time& stamp) {
  const nav_msgs::Odometry::ConstPtr odometry = toOdometryMsg(pose, frames, stamp);
  odometry_publisher_.publish(odometry);
  if (const std::string error = otherParentError(); !error.empty()) {
    const std::string sentence = other_warnings_.count("tf", error);
    if (!sentence.empty()) NODELET_ERROR_STREAM(getName() << ": " << sentence);
  } else if (tf_broadcaster_ && !isOfLastPass(stamp)) {
    tf_broadcaster_->sendTransform(toTransformMsg(*odometry));
  }

  geometry_msgs::PoseStamped stamped;
  stamped.header = odometry->header;
  stamped.pose = odometry->pose.pose;
  if (path_->add(stamped) && path_publisher_.getNumSubscribers() > 0) publishPath();
}

bool ScaleRecoveryNodelet::isOfLastPass(const ros::Time& stamp) {
  if (!ros::Time::isSimTime()) return false;
  const ros::Time now = ros::Time::now();
  latest_clock_ = std::max(latest_clock_, now);
  // Not by the stamp alone: those of a bag may always be ahead of its clock.
  return secondsBetween(now, latest_clock_) > params_.clock_jump_s &&
         secondsBetween(now, stamp) > params_.clock_jump_s;
}

void ScaleRecoveryNodelet::publishPath() {
  auto path = boost::make_shared<nav_msgs::Path>();
  path->header.frame_id = params_.odom_frame;
  path->poses = path_->poses();
  path->header.stamp = path->poses.empty() ? last_stamp_ : path->poses.back().header.stamp;
  path_publisher_.publish(path);
}

void ScaleRecoveryNodelet::publishGround(const ScaleRecovery::Output& output,
                                         const std_msgs::Header& header) {
  if (ground_points_publisher_.getNumSubscribers() > 0) {
    std::vector<Eigen::Vector3f> metric = output.ground_points_c;
    for (Eigen::Vector3f& point : metric) point *= static_cast<float>(output.scale.scale);
    ground_points_publisher_.publish(toPointCloud(metric, header));
  }
  if (ground_plane_publisher_.getNumSubscribers() > 0) {
    for (const auto& marker : toPlaneMarkers(output.scale, header)) {
      ground_plane_publisher_.publish(marker);
    }
  }
}

std::string ScaleRecoveryNodelet::otherParentError() const {
  if (!tf_broadcaster_ || !odometry_frames_) return {};
  const std::string& child = odometry_frames_->base_frame;
  const std::string parent =
      frame_parents_.otherParent(child, params_.odom_frame, FrameParents::Clock::now());
  if (parent.empty()) return {};
  const std::string root = frame_parents_.staticRoot(child);
  return "frame \"" + child + "\" has the parent \"" + parent + "\" on tf, so " +
         params_.odom_frame + " -> " + child + " is not broadcast; set " +
         (root == child ? "publish_tf to false, or stop the other publisher"
                        : "base_frame to \"" + root + "\"");
}

void ScaleRecoveryNodelet::warn(const std::string& kind, const std::string& text) {
  const std::string sentence = other_warnings_.count(kind, text);
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

void ScaleRecoveryNodelet::drop(const std::string& kind, const std::string& reason) {
  const std::string sentence = warnings_.count(kind, reason);
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

void ScaleRecoveryNodelet::record(const ScaleRecovery::Output& output, const ros::Time& stamp,
                                  bool has_image) {
  ++processed_;
  since_processed_.emplace();
  last_frame_had_image_ = has_image;
  if (has_image) ++processed_with_image_;
  if (output.direct.height > 0) ++with_direct_;
  last_scale_ = output.scale;
  last_stamp_ = stamp;
  if (output.scale.status == ScaleStatus::kOk) last_measurement_ = stamp;
  if (output.scale.status != ScaleStatus::kHeld ||
      output.scale.measurement == MeasurementStatus::kStandstill) {
    held_since_ = ros::Time();
  } else if (held_since_.isZero()) {
    held_since_ = stamp;
  }
  if (output.pose) distance_m_ = output.pose->distance;
}

std::string ScaleRecoveryNodelet::imageState() const {
  if (!receiver_) return "not used";
  if (!receiver_->hasImagePublisher()) return "no publisher on " + receiver_->imageTopic();
  if (!receiver_->camera()) {
    return "no valid camera_info received yet on " + receiver_->cameraInfoTopic();
  }
  return last_frame_had_image_ ? "used" : "no image of the last frame";
}

void ScaleRecoveryNodelet::warnOfMissingInput(const ScaleRecoveryState& state) {
  const std::string sentence = missing_input_log_.due(missingInput(state), ros::Time::now());
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

void ScaleRecoveryNodelet::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::uint64_t dropped = sequence_check_.missing() + warnings_.total("frame ");
  ScaleRecoveryState state;
  state.frames.topic = frame_subscriber_.getTopic();
  if (since_frame_) state.frames.silent_s = since_frame_->seconds();
  if (since_processed_) state.frames.unused_s = since_processed_->seconds();
  state.frames.dropped = dropped - dropped_at_last_diagnosis_;
  state.frames.clock_error = missingClock();
  state.status = last_scale_.status;
  state.reason = last_scale_.measurement;
  if (!held_since_.isZero()) state.held_s = secondsBetween(held_since_, last_stamp_);
  state.mounting_error = mounting_error_;
  state.mounting_warning = mounting_warning_;
  state.tf_error = otherParentError();
  if (receiver_) state.source_error = receiver_->sourceError();
  state.sequence_error = sequence_check_.error();
  if (receiver_ && processed_ > processed_at_last_diagnosis_ &&
      processed_with_image_ == with_image_at_last_diagnosis_) {
    state.missing_image_note = imageState();
  }
  dropped_at_last_diagnosis_ = dropped;
  processed_at_last_diagnosis_ = processed_;
  with_image_at_last_diagnosis_ = processed_with_image_;

  warnOfMissingInput(state);
  const DiagnosticSummary summary = summarize(state);
  status.summary(static_cast<std::uint8_t>(summary.level), summary.message);
  addValues(status);
}

void ScaleRecoveryNodelet::addValues(diagnostic_updater::DiagnosticStatusWrapper& status) {
  status.add("rate [Hz]", rate_.rate(processed_));
  status.add("time of the last frame [ms]", frame_ms_);
  status.add("frames processed", processed_);
  status.add("frames dropped, queue full", sequence_check_.missing());
  status.add("images", imageState());
  status.add("frames without an image", processed_ - processed_with_image_);
  status.add("frames with a direct measurement", with_direct_);
  for (const auto& [kind, count] : warnings_.counts()) status.add("dropped: " + kind, count);
  status.add("scale status", toString(last_scale_.status));
  status.add("reason", toString(last_scale_.measurement));
  status.add("scale [m / VO unit]", last_scale_.scale);
  status.add("sigma [m / VO unit]", last_scale_.sigma);
  if (!last_measurement_.isZero()) {
    status.add("age of the last measurement [s]", secondsBetween(last_measurement_, last_stamp_));
  }
  status.add("distance [m]", distance_m_);
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::ScaleRecoveryNodelet, nodelet::Nodelet)
