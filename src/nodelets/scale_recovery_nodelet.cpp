#include "ground_scale_vo/nodelets/scale_recovery_nodelet.hpp"

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/Marker.h>

#include <boost/make_shared.hpp>
#include <exception>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/nodelets/image_subscription.hpp"
#include "ground_scale_vo/nodelets/load_params.hpp"
#include "ground_scale_vo/ros/health.hpp"
#include "ground_scale_vo/ros/visuals.hpp"

namespace ground_scale_vo {
namespace {

constexpr std::uint32_t kPublishQueue = 100;
constexpr std::uint32_t kInfoQueue = 100;
constexpr double kDiagnosticsPeriod = 1.0;  // [s] wall time
constexpr double kWaitingPeriod = 0.1;      // [s] wall time, between looks at frames that wait

double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return 1e-9 * static_cast<double>(toNanoseconds(to) - toNanoseconds(from));
}

}  // namespace

ScaleRecoveryNodelet::~ScaleRecoveryNodelet() { callbacks_.stop(); }

void ScaleRecoveryNodelet::onInit() {
  ros::NodeHandle handle = callbacks_.handle(getNodeHandle());
  ros::NodeHandle private_handle = callbacks_.handle(getPrivateNodeHandle());
  params_ = loadParams<ScaleRecoveryParams>(getName(), private_handle);

  recovery_ = std::make_unique<ScaleRecovery>(params_.scale);
  guard_ = std::make_unique<StampGuard>(params_.clock_jump_s);
  path_ = std::make_unique<BoundedPath>(static_cast<std::size_t>(params_.path_max_poses),
                                        params_.path_spacing_m);
  stream_ = std::make_unique<CameraStream>(params_.image_is_rectified);
  Pairing::Limits limits;
  limits.images = static_cast<std::size_t>(params_.image_buffer);
  pairing_ = std::make_unique<Pairing>(limits);
  if (!params_.base_frame.empty()) {
    tf_buffer_ = std::make_unique<tf2_ros::Buffer>();
    tf_listener_ = std::make_unique<tf2_ros::TransformListener>(*tf_buffer_, handle);
  }
  if (params_.publish_tf) tf_broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();

  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("odometry", kPublishQueue);
  scale_publisher_ = handle.advertise<ScaleEstimateMsg>("scale", kPublishQueue);
  path_publisher_ = handle.advertise<nav_msgs::Path>("path", 1);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("points", 1);
  ground_points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("ground_points", 1);
  ground_plane_publisher_ = handle.advertise<visualization_msgs::Marker>("ground_plane", 2);

  updater_ = std::make_unique<diagnostic_updater::Updater>(handle, private_handle, getName());
  updater_->setHardwareID("none");
  updater_->add("scale", this, &ScaleRecoveryNodelet::diagnose);
  diagnostics_timer_ =
      handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                             [this](const ros::WallTimerEvent&) { updater_->force_update(); });

  reset_server_ = handle.advertiseService("reset", &ScaleRecoveryNodelet::onReset, this);
  if (params_.scale.resolved().refine) {
    useImages(handle, private_handle);
  }
  // Last: who sees this subscription knows that no image is missed.
  frame_subscriber_ = handle.subscribe("vo/frame", static_cast<std::uint32_t>(params_.queue_size),
                                       &ScaleRecoveryNodelet::onFrame, this);
  callbacks_.start();
}

void ScaleRecoveryNodelet::useImages(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  transport_ = std::make_unique<image_transport::ImageTransport>(handle);
  road_publisher_ = transport_->advertise("image_road", 1);
  camera_info_subscriber_ =
      handle.subscribe("camera_info", kInfoQueue, &ScaleRecoveryNodelet::onCameraInfo, this);
  image_subscriber_ = subscribeToImages(*transport_, private_handle,
                                        static_cast<std::uint32_t>(params_.image_buffer),
                                        &ScaleRecoveryNodelet::onImage, this, getName());
  waiting_timer_ = handle.createWallTimer(ros::WallDuration(kWaitingPeriod),
                                          [this](const ros::WallTimerEvent&) { processReady(); });
}

bool ScaleRecoveryNodelet::onReset(std_srvs::Trigger::Request& /*request*/,
                                   std_srvs::Trigger::Response& response) {
  processReady(false);
  reset();
  response.success = true;
  response.message = "the scale is unknown and the odometry starts anew";
  return true;
}

void ScaleRecoveryNodelet::reset() {
  recovery_->reset();
  path_->clear();
  last_scale_ = ScaleEstimate();
  last_measured_ = held_since_ = ros::Time();
  distance_m_ = 0;
}

void ScaleRecoveryNodelet::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  try {
    stream_->accept(*info, camera_info_subscriber_.getTopic());
  } catch (const MessageError& error) {
    report("camera_info refused", error.what());
  }
}

void ScaleRecoveryNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  pairing_->addImage(toNanoseconds(image->header.stamp), image);
  processReady();
}

void ScaleRecoveryNodelet::onFrame(const VoFrameMsg::ConstPtr& msg) {
  if (last_received_ && msg->sequence > *last_received_ + 1) {
    overtaken_ += msg->sequence - *last_received_ - 1;
  }
  last_received_ = msg->sequence;
  since_received_.emplace();
  VoFrame frame;
  try {
    frame = fromMsg(*msg);
  } catch (const MessageError& error) {
    return report("frame refused", error.what());
  }
  switch (guard_->check(msg->header.stamp)) {
    case StampGuard::Verdict::kDrop:
      return report("frame stamp", guard_->reason());
    case StampGuard::Verdict::kJumpedBack:
      NODELET_WARN("The clock jumped back: starting anew.");
      processReady(false);
      pairing_->jumpBack(frame.stamp_ns);
      reset();
      break;
    case StampGuard::Verdict::kNext:
      break;
  }
  const std::int64_t stamp_ns = frame.stamp_ns;
  pairing_->addFrame(stamp_ns, {std::move(frame), msg->header}, Pairing::Clock::now());
  processReady();
}

void ScaleRecoveryNodelet::processReady(bool may_wait) {
  while (std::optional<Pairing::Pair> pair = pairing_->next(Pairing::Clock::now(), may_wait)) {
    process(std::move(pair->frame.frame), pair->frame.header, pair->image);
  }
}

cv::Mat ScaleRecoveryNodelet::pictureOf(const VoFrame& frame,
                                        const sensor_msgs::ImageConstPtr& image) {
  const std::shared_ptr<const CalibratedCamera> camera = stream_->camera();
  if (!image || !camera) return {};
  if (!camera->isCameraOf(frame.camera)) {
    report("other camera", "camera_info on topic " + camera_info_subscriber_.getTopic() +
                               " describes another camera than " + frame_subscriber_.getTopic());
    return {};
  }
  try {
    return camera->rectified(*image, &grey_);
  } catch (const std::exception& error) {
    report("image refused", error.what());
    return {};
  }
}

void ScaleRecoveryNodelet::process(VoFrame frame, const std_msgs::Header& header,
                                   const sensor_msgs::ImageConstPtr& image) {
  const Stopwatch watch;
  renumberMap(frame);
  const cv::Mat picture = pictureOf(frame, image);
  ScaleRecovery::Output output;
  try {
    output = recovery_->process(frame, picture);
  } catch (const std::exception& error) {
    return report("frame failed", error.what());
  }
  scale_publisher_.publish(toMsg(output.scale, frame.map_id, header));
  if (output.scale.status != ScaleStatus::kUnknown) {
    if (output.pose) publishPose(*output.pose, header);
    publishGround(output, header);
    if (points_publisher_.getNumSubscribers() > 0) {
      points_publisher_.publish(toPointCloud(frame, header, output.scale.scale));
    }
  }
  if (road_publisher_.getNumSubscribers() > 0 && !picture.empty()) {
    road_publisher_.publish(paintRoad(picture, frame, output, header));
  }

  ++processed_;
  last_had_image_ = !picture.empty();
  if (last_had_image_) ++with_image_;
  if (output.direct.height > 0) ++refined_;
  last_scale_ = output.scale;
  last_stamp_ = header.stamp;
  if (output.scale.status == ScaleStatus::kOk) last_measured_ = last_stamp_;
  if (output.scale.status != ScaleStatus::kHeld ||
      output.scale.reason == ScaleReason::kStandstill) {
    held_since_ = ros::Time();
  } else if (held_since_.isZero()) {
    held_since_ = last_stamp_;
  }
  if (output.pose) distance_m_ = output.pose->distance;
  frame_ms_ = watch.ms();
}

void ScaleRecoveryNodelet::renumberMap(VoFrame& frame) {
  if (last_sequence_ && frame.sequence <= *last_sequence_) map_offset_ = last_map_id_ + 1;
  last_sequence_ = frame.sequence;
  frame.map_id += map_offset_;
  last_map_id_ = frame.map_id;
}

const OdometryFrames* ScaleRecoveryNodelet::framesFor(const std::string& camera_frame) {
  if (frames_ && frames_camera_ == camera_frame) return &*frames_;
  frames_.reset();
  if (camera_frame.empty()) {
    no_frames_ = "the images have an empty frame_id, so there is no frame to publish";
    report("no frame_id", no_frames_);
    return nullptr;
  }
  if (params_.base_frame.empty() || params_.base_frame == camera_frame) {
    frames_ = OdometryFrames::ofCamera(params_.odom_frame, camera_frame);
  } else {
    try {
      const geometry_msgs::TransformStamped mounting =
          tf_buffer_->lookupTransform(params_.base_frame, camera_frame, ros::Time(0));
      frames_ = OdometryFrames::ofBase(params_.odom_frame, params_.base_frame,
                                       fromMsg(mounting.transform));
    } catch (const std::exception& error) {
      no_frames_ = "tf knows no way from base_frame \"" + params_.base_frame +
                   "\" to the camera \"" + camera_frame + "\", so nothing metric is published";
      const std::string sentence = faults_.report("no tf", no_frames_ + ": " + error.what());
      if (!sentence.empty()) NODELET_ERROR_STREAM(getName() << ": " << sentence);
      return nullptr;
    }
  }
  frames_camera_ = camera_frame;
  return &*frames_;
}

void ScaleRecoveryNodelet::publishPose(const MetricPose& pose, const std_msgs::Header& header) {
  const OdometryFrames* const frames = framesFor(header.frame_id);
  if (frames == nullptr) return;

  const nav_msgs::Odometry::ConstPtr odometry = toOdometryMsg(pose, *frames, header.stamp);
  odometry_publisher_.publish(odometry);
  if (tf_broadcaster_) tf_broadcaster_->sendTransform(toTransformMsg(*odometry));

  geometry_msgs::PoseStamped stamped;
  stamped.header = odometry->header;
  stamped.pose = odometry->pose.pose;
  if (path_->add(stamped) && path_publisher_.getNumSubscribers() > 0) {
    auto path = boost::make_shared<nav_msgs::Path>();
    path->header = odometry->header;
    path->poses = path_->poses();
    path_publisher_.publish(path);
  }
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

void ScaleRecoveryNodelet::report(const std::string& kind, const std::string& why) {
  const std::string sentence = faults_.report(kind, why);
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

std::string ScaleRecoveryNodelet::imagesState() const {
  if (!transport_) return "not used";
  if (image_subscriber_.getNumPublishers() == 0) {
    return "no image: nobody publishes " + image_subscriber_.getTopic();
  }
  if (!stream_->camera()) {
    return "no image: no usable camera_info yet on " + camera_info_subscriber_.getTopic();
  }
  return last_had_image_ ? "used" : "no image of the last frame";
}

void ScaleRecoveryNodelet::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::uint64_t left_out = overtaken_ + faults_.count("frame ");
  ScaleFacts facts;
  facts.frames.topic = frame_subscriber_.getTopic();
  if (since_received_) facts.frames.silent_s = since_received_->seconds();
  facts.frames.left_out = left_out - left_out_;
  facts.status = last_scale_.status;
  facts.reason = last_scale_.reason;
  if (!held_since_.isZero()) facts.held_s = secondsBetween(held_since_, last_stamp_);
  if (!frames_) facts.no_frames = no_frames_;
  if (transport_ && processed_ > diagnosed_ && with_image_ == diagnosed_with_image_) {
    facts.without_images = imagesState();
  }
  left_out_ = left_out;
  diagnosed_ = processed_;
  diagnosed_with_image_ = with_image_;

  const Health health = healthOf(facts);
  status.summary(static_cast<std::uint8_t>(health.level), health.message);
  status.add("rate [Hz]", rate_.rate(processed_));
  status.add("time of the last frame [ms]", frame_ms_);
  status.add("frames processed", processed_);
  status.add("frames overtaken by newer ones", overtaken_);
  status.add("images", imagesState());
  status.add("frames without an image", processed_ - with_image_);
  status.add("frames refined", refined_);
  for (const auto& [kind, count] : faults_.counts()) status.add("dropped: " + kind, count);
  status.add("scale status", toString(last_scale_.status));
  status.add("reason", toString(last_scale_.reason));
  status.add("scale [m / VO unit]", last_scale_.scale);
  status.add("sigma [m / VO unit]", last_scale_.sigma);
  if (!last_measured_.isZero()) {
    status.add("age of the last measured scale [s]", secondsBetween(last_measured_, last_stamp_));
  }
  status.add("distance [m]", distance_m_);
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::ScaleRecoveryNodelet, nodelet::Nodelet)
