#include "ground_scale_vo/nodelets/mono_vo_nodelet.hpp"

#include <nav_msgs/Odometry.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <exception>
#include <pluginlib/class_list_macros.hpp>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/nodelets/image_subscription.hpp"
#include "ground_scale_vo/nodelets/load_params.hpp"
#include "ground_scale_vo/ros/health.hpp"

namespace ground_scale_vo {
namespace {

/// The callbacks only store, so these never fill; what is lost is lost, and counted, in images_.
constexpr std::uint32_t kTransportQueue = 100;
constexpr std::uint32_t kPublishQueue = 100;
constexpr double kDiagnosticsPeriod = 1.0;  // [s] wall time

}  // namespace

MonoVoNodelet::~MonoVoNodelet() {
  callbacks_.stop();
  if (images_) images_->close();
  if (thread_.joinable()) thread_.join();
}

void MonoVoNodelet::onInit() {
  ros::NodeHandle handle = callbacks_.handle(getNodeHandle());
  ros::NodeHandle private_handle = callbacks_.handle(getPrivateNodeHandle());
  params_ = loadParams<MonoVoParams>(getName(), private_handle);

  guard_ = std::make_unique<StampGuard>(params_.clock_jump_s);
  stream_ = std::make_unique<CameraStream>(params_.image_is_rectified);
  images_ = std::make_unique<BoundedQueue<sensor_msgs::ImageConstPtr>>(
      static_cast<std::size_t>(params_.queue_size));

  transport_ = std::make_unique<image_transport::ImageTransport>(handle);
  frame_publisher_ = handle.advertise<VoFrameMsg>("vo/frame", kPublishQueue);
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("vo/odometry", kPublishQueue);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("vo/points", 1);
  tracks_publisher_ = transport_->advertise("vo/image_tracks", 1);

  updater_ = std::make_unique<diagnostic_updater::Updater>(handle, private_handle, getName());
  updater_->setHardwareID("none");
  updater_->add("odometry", this, &MonoVoNodelet::diagnose);

  thread_ = std::thread(&MonoVoNodelet::work, this);
  camera_info_subscriber_ =
      handle.subscribe("camera_info", kTransportQueue, &MonoVoNodelet::onCameraInfo, this);
  image_subscriber_ = subscribeToImages(*transport_, private_handle, kTransportQueue,
                                        &MonoVoNodelet::onImage, this, getName());
  diagnostics_timer_ =
      handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                             [this](const ros::WallTimerEvent&) { updater_->force_update(); });
  callbacks_.start();
}

void MonoVoNodelet::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  std::string refused;
  try {
    stream_->accept(*info, camera_info_subscriber_.getTopic());
    images_->release();
  } catch (const MessageError& error) {
    refused = error.what();
    drop("camera_info refused", refused);
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  state_.info_refused = std::move(refused);
}

void MonoVoNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  const bool kept_all = images_->push(image);
  const std::lock_guard<std::mutex> lock(mutex_);
  ++state_.received;
  state_.since_received.emplace();
  if (!kept_all) ++state_.overtaken;
}

void MonoVoNodelet::work() {
  while (const std::optional<sensor_msgs::ImageConstPtr> image = images_->pop()) {
    try {
      process(**image);
    } catch (const std::exception& error) {
      drop("image failed", error.what());
    }
  }
}

void MonoVoNodelet::process(const sensor_msgs::Image& image) {
  const Stopwatch watch;
  const std::shared_ptr<const CalibratedCamera> camera = stream_->camera();
  cv::Mat rectified;
  try {
    rectified = camera->rectified(image, &grey_);
  } catch (const MessageError& error) {
    return drop("image refused", error.what());
  }
  const StampGuard::Verdict verdict = guard_->check(image.header.stamp);
  if (verdict == StampGuard::Verdict::kDrop) return drop("image stamp", guard_->reason());

  prepareOdometry(camera, verdict == StampGuard::Verdict::kJumpedBack);
  const VisualOdometry::Output output =
      odometry_->process(rectified, toNanoseconds(image.header.stamp));
  publish(rectified, output, image.header);

  const std::lock_guard<std::mutex> lock(mutex_);
  ++state_.processed;
  state_.status = output.frame.status;
  state_.map_id = output.frame.map_id;
  state_.features = output.frame.features.size();
  state_.points = static_cast<std::size_t>(
      std::count_if(output.frame.features.begin(), output.frame.features.end(),
                    [](const TrackedFeature& feature) { return feature.has_point; }));
  state_.frame_ms = watch.ms();
}

void MonoVoNodelet::prepareOdometry(const std::shared_ptr<const CalibratedCamera>& camera,
                                    bool clock_jumped_back) {
  if (odometry_ && clock_jumped_back) NODELET_WARN("The clock jumped back: starting anew.");
  if (odometry_ && camera != odometry_camera_) NODELET_WARN("The camera changed: starting anew.");
  if (odometry_ && !clock_jumped_back && camera == odometry_camera_) return;
  odometry_ = std::make_unique<VisualOdometry>(camera->camera(), params_.vo);
  odometry_camera_ = camera;
  painter_ = TrackPainter();
}

void MonoVoNodelet::publish(const cv::Mat& rectified, const VisualOdometry::Output& output,
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
    tracks_publisher_.publish(painter_.paint(rectified, frame, output.rejected, header));
  }
}

void MonoVoNodelet::drop(const std::string& kind, const std::string& why) {
  const std::string sentence = faults_.report(kind, why);
  if (!sentence.empty()) NODELET_WARN_STREAM(getName() << ": " << sentence);
}

void MonoVoNodelet::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(mutex_);

  const std::uint64_t left_out = state_.overtaken + faults_.count("image ");
  MonoVoFacts facts;
  facts.images.topic = image_subscriber_.getTopic();
  if (state_.since_received) facts.images.silent_s = state_.since_received->seconds();
  facts.images.left_out = left_out - left_out_;
  facts.info_topic = camera_info_subscriber_.getTopic();
  facts.camera_known = stream_->camera() != nullptr;
  facts.info_refused = state_.info_refused;
  facts.status = state_.status;
  left_out_ = left_out;

  const Health health = healthOf(facts);
  status.summary(static_cast<std::uint8_t>(health.level), health.message);
  status.add("rate [Hz]", rate_.rate(state_.processed));
  status.add("time of the last frame [ms]", state_.frame_ms);
  status.add("images received", state_.received);
  status.add("images processed", state_.processed);
  status.add("images overtaken by newer ones", state_.overtaken);
  for (const auto& [kind, count] : faults_.counts()) status.add("dropped: " + kind, count);
  status.add("map_id", state_.map_id);
  status.add("features", state_.features);
  status.add("map points", state_.points);
}

}  // namespace ground_scale_vo

PLUGINLIB_EXPORT_CLASS(ground_scale_vo::MonoVoNodelet, nodelet::Nodelet)
