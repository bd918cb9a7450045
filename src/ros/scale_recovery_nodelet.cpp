#include <sensor_msgs/PointCloud2.h>
#include <topic_tools/shape_shifter.h>
#include <visualization_msgs/Marker.h>

#include <algorithm>
#include <exception>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <utility>
#include <vector>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ros/odometry_output.hpp"
#include "ros/scale_input.hpp"
#include "ros/stage_nodelet.hpp"
#include "ros/visuals.hpp"

namespace gsv {
namespace {

/// [images] that may wait for their frame, at least: one second of a 30 Hz camera.
constexpr int kMinImageBuffer = 30;
/// [images] beyond queue_size: another odometry is late by those that arrive while it works, too.
constexpr int kImageMargin = 10;
constexpr std::uint32_t kSpeedQueue = 1000;  // [speeds] ten seconds at 100 Hz
constexpr double kWaitingPeriod = 0.1;       // [s] wall time, between checks of waiting frames

std::uint32_t imageBuffer(const ScaleRecoveryParams& params) {
  return static_cast<std::uint32_t>(std::max(kMinImageBuffer, params.queue_size + kImageMargin));
}

}  // namespace

/// vo/frame, the image on which its odometry worked (vo/image, vo/mask), and speed if used ->
/// scale, odometry, path, tf; for visualisation image_road, points, ground_points, ground_plane.
/// Services ~reset, and with use_speed ~save_height.
class ScaleRecoveryNodelet : public StageNodelet {
 public:
  ScaleRecoveryNodelet() : StageNodelet("scale", "vo/frame", "frames") {}
  ~ScaleRecoveryNodelet() override { stopCallbacks(); }

 private:
  struct ReceivedFrame {
    VoFrame vo;
    std_msgs::Header header;
    bool clock_jumped_back = false;  ///< between the previous one and this one
  };
  using Synchronizer = FrameImageSynchronizer<ReceivedFrame, sensor_msgs::ImageConstPtr>;

  void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) override;
  std::string reset() override;
  State describe(Diagnostics& status) override;

  void subscribeToImages(ros::NodeHandle& handle);
  void subscribeToSpeed(ros::NodeHandle& handle);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onMask(const sensor_msgs::ImageConstPtr& mask);
  void onFrame(const VoFrameMsg::ConstPtr& msg);
  void onSpeed(const ros::MessageEvent<const topic_tools::ShapeShifter>& event);
  /// Processes the frames that do not wait for their image; all of them unless they may_wait.
  void processReady(bool may_wait = true);
  void process(ReceivedFrame received, const sensor_msgs::ImageConstPtr& image);
  /// Grey, with the mask. Empty if there is none, or it cannot be used.
  CameraImage imageOf(const VoFrame& frame, const sensor_msgs::ImageConstPtr& image);
  /// Forgets what was published and reported of the trajectory; recovery_ restarts by itself, with
  /// the next frame.
  void restart(bool first_pose_is_zero);

  void publish(const ScaleRecovery::Output& output, const VoFrame& frame, const CameraImage& image,
               const std_msgs::Header& header);
  /// Keeps what the diagnostics report about the frame, and logs its warnings.
  void record(ScaleRecovery::Output output, const VoFrame& frame, bool has_image);
  std::string imageState() const;
  std::string saveHeight() const;

  ScaleRecoveryParams params_;

  // Input.
  std::unique_ptr<Synchronizer> synchronizer_;
  ros::Subscriber image_subscriber_, mask_subscriber_;  ///< with refine
  GreyConverter grey_converter_;
  cv::Mat mask_;  ///< empty: none
  ros::WallTimer waiting_timer_;
  ros::Subscriber frame_subscriber_;
  std::unique_ptr<StampFilter> stamp_filter_;
  FrameContinuity continuity_;
  Continuity unprocessed_ = Continuity::kSameMap;  ///< of the last frame, if its processing failed
  ros::Subscriber speed_subscriber_;               ///< with use_speed
  std::uint64_t speeds_received_ = 0;
  std::unique_ptr<SpeedReader> speed_reader_;
  std::string speed_error_;  ///< why the newest speed was refused; empty: it was not
  std::optional<std::int64_t> newest_speed_ns_;

  std::unique_ptr<ScaleRecovery> recovery_;

  // Output.
  std::unique_ptr<OdometryOutput> output_;
  ros::Publisher scale_publisher_, points_publisher_, ground_points_publisher_,
      ground_plane_publisher_, road_publisher_;

  /// What the diagnostics report of the trajectory.
  struct Report {
    TurnAxis turn_axis;
    std::vector<std::string> warnings;  ///< of the last frame
    ScaleRecovery::Output last;
    std::int64_t stamp_ns = 0;
    std::optional<std::int64_t> measured_ns;  ///< last measurement
    /// First of the latest HELD frames in a row without standstill; empty: the last frame is none.
    std::optional<std::int64_t> held_since_ns;
    double distance_m = 0;
  };
  Report report_;
  std::uint64_t with_image_ = 0, with_direct_ = 0;  ///< frames
  std::uint64_t diagnosed_processed_ = 0, diagnosed_with_image_ = 0;
  bool last_frame_had_image_ = false;
};

void ScaleRecoveryNodelet::start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  params_ = loadParams<ScaleRecoveryParams>(private_handle);
  recovery_ = std::make_unique<ScaleRecovery>(params_.scale);
  stamp_filter_ = std::make_unique<StampFilter>(
      params_.clock_jump_s,
      [this](const std::string& reason) { log_->drop("frame stamp", withMissingClock(reason)); });
  synchronizer_ = std::make_unique<Synchronizer>(imageBuffer(params_));

  output_ = std::make_unique<OdometryOutput>(handle, params_, log_.get());
  scale_publisher_ = handle.advertise<ScaleEstimateMsg>("scale", kPublishQueue);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("points", 1);
  ground_points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("ground_points", 1);
  ground_plane_publisher_ = handle.advertise<visualization_msgs::Marker>("ground_plane", 1);
  if (params_.scale.refine) subscribeToImages(handle);
  if (params_.scale.use_speed) {
    speed_reader_ = std::make_unique<SpeedReader>(params_.speed_unit);
    subscribeToSpeed(handle);
    advertise(private_handle, "save_height", [this] { return saveHeight(); });
  }
  // Last: a publisher that sees this subscription can rely on the subscription to the images.
  frame_subscriber_ = handle.subscribe("vo/frame", static_cast<std::uint32_t>(params_.queue_size),
                                       &ScaleRecoveryNodelet::onFrame, this);
}

void ScaleRecoveryNodelet::subscribeToImages(ros::NodeHandle& handle) {
  mask_subscriber_ = handle.subscribe("vo/mask", 10, &ScaleRecoveryNodelet::onMask, this);
  image_subscriber_ =
      handle.subscribe("vo/image", imageBuffer(params_), &ScaleRecoveryNodelet::onImage, this);
  road_publisher_ = handle.advertise<sensor_msgs::Image>("image_road", 1);
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
  output_->restart(first_pose_is_zero);
  report_ = Report();
}

void ScaleRecoveryNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  synchronizer_->addImage(toNanoseconds(image->header.stamp), image);
  processReady();
}

void ScaleRecoveryNodelet::onMask(const sensor_msgs::ImageConstPtr& message) {
  try {
    mask_ = GreyConverter().convert(fromMsg(*message)).clone();
  } catch (const DataError& error) {
    log_->drop("mask refused", error.what());
    return;
  }
  if (cv::countNonZero(mask_) == mask_.size().area()) mask_.release();
}

void ScaleRecoveryNodelet::onFrame(const VoFrameMsg::ConstPtr& msg) {
  countInput();
  continuity_.receive(msg->sequence);
  if (!continuity_.sequenceError().empty()) log_->warn("sequence", continuity_.sequenceError());
  ReceivedFrame received;
  received.header = msg->header;
  received.header.frame_id = tfFrame(msg->header.frame_id, "frame_id of vo/frame");
  try {
    received.vo = fromMsg(*msg);
  } catch (const DataError& error) {
    log_->drop("frame refused", error.what());
    return;
  }
  auto accept = [this, frame = std::move(received)](bool clock_jumped_back) mutable {
    frame.clock_jumped_back = clock_jumped_back;
    const std::string reason = continuity_.next(frame.vo, frame.header.frame_id, clock_jumped_back);
    if (!reason.empty()) {
      NODELET_WARN_STREAM(getName() << ": scale and odometry are reset: " << reason);
    }
    const std::int64_t stamp_ns = frame.vo.stamp_ns;
    if (clock_jumped_back) {
      processReady(false);
      synchronizer_->jumpBack(stamp_ns);
    }
    synchronizer_->addFrame(stamp_ns, std::move(frame), Synchronizer::Clock::now());
  };
  stamp_filter_->add(toNanoseconds(msg->header.stamp), std::move(accept));
  processReady();
}

/// Not to the odometry of these nodelets, which the speeds would only confirm.
void ScaleRecoveryNodelet::subscribeToSpeed(ros::NodeHandle& handle) {
  const std::string topic = handle.resolveName("speed");
  for (const char* own : {"odometry", "vo/odometry"}) {
    if (topic != handle.resolveName(own)) continue;
    speed_error_ = "speed is the nodelets' own output " + topic +
                   ", which measures nothing: remap it to a sensor of the vehicle";
    log_->error("own speed", speed_error_);
    return;
  }
  speed_subscriber_ = handle.subscribe("speed", kSpeedQueue, &ScaleRecoveryNodelet::onSpeed, this);
}

void ScaleRecoveryNodelet::onSpeed(
    const ros::MessageEvent<const topic_tools::ShapeShifter>& event) {
  ++speeds_received_;
  speed_error_.clear();
  try {
    const SpeedSample speed = speed_reader_->read(*event.getMessage(), event.getReceiptTime());
    recovery_->addSpeed(speed);
    newest_speed_ns_ = speed.stamp_ns;
  } catch (const DataError& error) {
    speed_error_ = "speed on " + speed_subscriber_.getTopic() + " " + error.what();
    log_->drop("speed refused", withMissingClock(speed_error_), true);
  }
}

void ScaleRecoveryNodelet::processReady(bool may_wait) {
  while (auto match = synchronizer_->next(Synchronizer::Clock::now(), may_wait)) {
    process(std::move(match->first), match->second);
  }
}

void ScaleRecoveryNodelet::process(ReceivedFrame received,
                                   const sensor_msgs::ImageConstPtr& message) {
  const Stopwatch watch;
  VoFrame& frame = received.vo;
  if (frame.continuity == Continuity::kNewTrajectory && processed() > 0) {
    restart(!received.clock_jumped_back);
  }
  frame.continuity = unprocessed_ = std::max(frame.continuity, unprocessed_);
  const CameraImage image = imageOf(frame, message);
  ScaleRecovery::Output output;
  try {
    output = recovery_->process(frame, image.grey, image.mask);
  } catch (const std::exception& error) {
    log_->drop("frame failed", error.what());
    return;
  }
  unprocessed_ = Continuity::kSameMap;
  publish(output, frame, image, received.header);
  record(std::move(output), frame, !image.grey.empty());
  countFrame(watch);
}

CameraImage ScaleRecoveryNodelet::imageOf(const VoFrame& frame,
                                          const sensor_msgs::ImageConstPtr& message) {
  if (!message) return {};
  CameraImage image;
  image.camera = frame.camera;
  image.mask = mask_;
  try {
    image.grey = grey_converter_.convert(fromMsg(*message));
    requireImage(image.grey, frame.camera);
    requireMask(image.mask, frame.camera, "the mask on " + mask_subscriber_.getTopic());
  } catch (const std::exception& error) {
    log_->drop("image refused", error.what());
    return {};
  }
  return image;
}

void ScaleRecoveryNodelet::publish(const ScaleRecovery::Output& output, const VoFrame& frame,
                                   const CameraImage& image, const std_msgs::Header& header) {
  scale_publisher_.publish(toMsg(output.scale, frame.map_id, header));
  output_->publish(output.pose, header);
  if (!image.grey.empty() && road_publisher_.getNumSubscribers() > 0) {
    road_publisher_.publish(paintRoad(image, frame, output, header));
  }
  if (output.scale.status == ScaleStatus::kUnknown) return;
  if (points_publisher_.getNumSubscribers() > 0) {
    points_publisher_.publish(toPointCloud(frame, header, output.scale.scale));
  }
  if (ground_points_publisher_.getNumSubscribers() > 0) {
    ground_points_publisher_.publish(
        toPointCloud(output.ground_points_c, header, output.scale.scale));
  }
  if (ground_plane_publisher_.getNumSubscribers() > 0 && hasGroundPlane(output.scale)) {
    ground_plane_publisher_.publish(toPlaneMarker(output.scale, header));
  }
}

void ScaleRecoveryNodelet::record(ScaleRecovery::Output output, const VoFrame& frame,
                                  bool has_image) {
  report_.turn_axis.add(frame);
  const auto& tf = output_->frames();
  const bool is_mounted =
      tf && tf->base_frame != continuity_.cameraFrame() && !params_.moving_mount;
  report_.warnings = {mountingWarning(output, report_.turn_axis.upward(),
                                      is_mounted ? &*tf : nullptr, continuity_.cameraFrame()),
                      output.speed_error.empty() ? output.speed_warning : ""};
  if (params_.scale.use_speed && !newest_speed_ns_) {
    report_.warnings.back() =
        speed_error_.empty() ? "no speed received yet on " + speed_subscriber_.getTopic() : "";
  }
  if (speed_reader_ && !speed_reader_->hasVehicleAxes()) {
    report_.warnings.push_back("the velocity on " + speed_subscriber_.getTopic() +
                               " is not along x, so its length without a sign is used");
  }
  for (const std::string& warning : report_.warnings) log_->warnOfState(warning);
  if (!output.speed_error.empty()) log_->error("speed error", output.speed_error);

  last_frame_had_image_ = has_image;
  if (has_image) ++with_image_;
  if (output.direct.plane.height > 0) ++with_direct_;
  report_.stamp_ns = frame.stamp_ns;
  if (output.scale.status == ScaleStatus::kOk) report_.measured_ns = frame.stamp_ns;
  if (output.scale.status != ScaleStatus::kHeld ||
      output.scale.measurement == MeasurementStatus::kStandstill) {
    report_.held_since_ns.reset();
  } else if (!report_.held_since_ns) {
    report_.held_since_ns = frame.stamp_ns;
  }
  if (output.pose) report_.distance_m = output.pose->distance;
  report_.last = std::move(output);
}

std::string ScaleRecoveryNodelet::saveHeight() const {
  if (params_.height_file.empty()) throw DataError("the parameter height_file names no file");
  const bool is_given = params_.scale.camera_height > 0;
  writeFile(params_.height_file,
            learnedHeightYaml(report_.last, is_given ? params_.scale.cameraHeightSigma() : 0));
  return "written to " + params_.height_file;
}

std::string ScaleRecoveryNodelet::imageState() const {
  if (!params_.scale.refine) return "not used";
  if (image_subscriber_.getNumPublishers() == 0) {
    return "no publisher on " + image_subscriber_.getTopic();
  }
  return last_frame_had_image_ ? "used" : "no image of the last frame";
}

StageNodelet::State ScaleRecoveryNodelet::describe(Diagnostics& status) {
  const bool has_frames = processed() > std::exchange(diagnosed_processed_, processed());
  const bool has_images = with_image_ > std::exchange(diagnosed_with_image_, with_image_);
  const ScaleEstimate& scale = report_.last.scale;
  status.summary(summarize(
      scale, report_.held_since_ns ? secondsBetween(*report_.held_since_ns, report_.stamp_ns) : 0,
      params_.scale.refine && has_frames && !has_images ? imageState() : ""));

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
  if (params_.scale.use_speed) {
    status.add("speeds received", speeds_received_);
    status.add("speed error", report_.last.speed_error);
  }
  if (newest_speed_ns_) {
    status.add("age of the newest speed [s]", secondsBetween(*newest_speed_ns_, report_.stamp_ns));
  }
  State state;
  state.dropped = continuity_.missing() + log_->dropped("frame ");
  state.missing = missingInput(frame_subscriber_.getTopic());
  state.errors = {output_->mountingError(), output_->otherBroadcasterError(), speed_error_,
                  report_.last.speed_error};
  state.warnings = report_.warnings;
  state.warnings.push_back(continuity_.sequenceError());
  return state;
}

}  // namespace gsv

PLUGINLIB_EXPORT_CLASS(gsv::ScaleRecoveryNodelet, nodelet::Nodelet)
