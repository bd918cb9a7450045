#include <image_transport/image_transport.h>
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstdint>
#include <deque>
#include <exception>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <pluginlib/class_list_macros.hpp>
#include <string>
#include <utility>

#include "common/files.hpp"
#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/stamps.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"
#include "ros/image_input.hpp"
#include "ros/stage_nodelet.hpp"
#include "ros/visuals.hpp"

namespace gsv {
namespace {

constexpr std::uint32_t kInputQueue = 100;  // [messages] that wait for their callback
constexpr std::size_t kMaxWaitingInfos = 20;
constexpr double kInfoPatience = 1.0;  // [s] wall time; a later camera_info is lost

}  // namespace

/// image + camera_info -> vo/frame, vo/odometry, and vo/image with vo/mask, on which the odometry
/// worked; for visualisation vo/image_tracks, vo/points. Services ~reset, and with refine_camera
/// ~save_camera.
///
/// The callback stores the image, a compressed one decoded; a posted task processes one stored
/// image after all callbacks that wait. So the newest `queue_size` images are always in the queue,
/// and dropped ones are counted exactly. Images and camera_info arrive on two connections, in any
/// order: an image has the latest camera_info that is not stamped later. While each image has one
/// of its own stamp, the next one waits for it, as long as the queue has room.
class MonoVoNodelet : public StageNodelet {
 public:
  MonoVoNodelet() : StageNodelet("odometry", "image", "images") {}
  ~MonoVoNodelet() override { stopCallbacks(); }

 private:
  using Camera = std::shared_ptr<const CameraCalibration>;
  struct ReceivedImage {
    std_msgs::Header header;
    cv::Mat pixels;  ///< may refer to the data of the message
    std::string encoding;
    sensor_msgs::ImageConstPtr message;
  };

  void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) override;
  std::string reset() override;
  State describe(Diagnostics& status) override;

  void subscribe(ros::NodeHandle& handle, const ros::NodeHandle& private_handle,
                 image_transport::ImageTransport* transport);
  std::string imageTopic() const;
  /// One sentence while the focal length is not that of the calibration, else empty.
  std::string zoomError() const;
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void useCameraInfos(const ros::Time& until);
  void useCameraInfo(const sensor_msgs::CameraInfo& info);
  /// The camera_info of the oldest stored image is still to come.
  bool awaitsCameraInfo() const;
  void onCompressedImage(const sensor_msgs::CompressedImageConstPtr& compressed);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  /// Does not wait for the camera_info of the stored images any longer.
  void giveUpCameraInfo();
  void dropImage(const std::string& kind, const std::string& reason);
  void store(const ReceivedImage& image);
  /// Posts a task that processes the oldest stored image, unless one is pending or none can run.
  void scheduleProcessing();
  void processOldest();
  /// May refer to the data of the message. Empty, after log_->drop(), if it cannot be used.
  cv::Mat greyOf(const ReceivedImage& image);
  void process(const ReceivedImage& image, const cv::Mat& grey, const Camera& camera,
               bool clock_jumped_back);
  /// Starts the odometry anew if the next image does not continue the ones before it: its sequence
  /// and map ids are 0 again.
  void startOdometry(const Camera& camera, bool clock_jumped_back);
  void publish(const SelfCalibratingOdometry::Output& output, const std_msgs::Header& header);
  void publishLens(const std_msgs::Header& header);
  std::string saveCamera() const;

  MonoVoParams params_;
  ros::Subscriber camera_info_subscriber_;        ///< without a camera file
  ros::Subscriber compressed_subscriber_;         ///< with `compressed` and `raw_or_compressed`
  image_transport::Subscriber image_subscriber_;  ///< with all but `compressed`
  std::unique_ptr<CameraInput> input_;
  std::deque<sensor_msgs::CameraInfoConstPtr> camera_infos_;  ///< that wait for their images
  ros::Time newest_info_, used_info_;                         ///< their stamps
  bool image_has_info_ = false;    ///< the last image was stamped as a camera_info
  std::string camera_info_error_;  ///< of the last camera_info; empty: it was accepted
  std::string image_error_;        ///< of the last image that was dropped
  std::deque<ReceivedImage> images_;
  ros::WallTimer info_patience_;  ///< runs while an image waits
  std::uint64_t dropped_from_queue_ = 0;
  bool processing_scheduled_ = false;
  std::unique_ptr<StampFilter> stamp_filter_;

  std::unique_ptr<SelfCalibratingOdometry> odometry_;  ///< null: the next image starts one
  Camera odometry_camera_;
  std::optional<VoFrame> last_frame_;  ///< of odometry_

  ros::Publisher frame_publisher_, image_publisher_, mask_publisher_, odometry_publisher_,
      points_publisher_, refined_camera_publisher_;
  image_transport::Publisher tracks_publisher_;
};

void MonoVoNodelet::start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) {
  params_ = loadParams<MonoVoParams>(private_handle);
  stamp_filter_ = std::make_unique<StampFilter>(
      params_.clock_jump_s,
      [this](const std::string& reason) { dropImage("image stamp", withMissingClock(reason)); });
  input_ = openCameraInput(params_.image_is_rectified, params_.mask, params_.camera_file);
  if (!params_.readout_time_is_given && input_->camera()) {
    params_.odometry.vo.readout_time = input_->camera()->readout_time;
  }
  log_->warnOfState(input_->warning());
  image_transport::ImageTransport transport(handle);
  info_patience_ = handle.createWallTimer(
      ros::WallDuration(kInfoPatience), [this](const ros::WallTimerEvent&) { giveUpCameraInfo(); },
      true, false);
  subscribe(handle, private_handle, &transport);
  frame_publisher_ = handle.advertise<VoFrameMsg>("vo/frame", kPublishQueue);
  image_publisher_ = handle.advertise<sensor_msgs::Image>("vo/image", kPublishQueue);
  mask_publisher_ = handle.advertise<sensor_msgs::Image>("vo/mask", 1, true);
  odometry_publisher_ = handle.advertise<nav_msgs::Odometry>("vo/odometry", kPublishQueue);
  points_publisher_ = handle.advertise<sensor_msgs::PointCloud2>("vo/points", 1);
  tracks_publisher_ = transport.advertise("vo/image_tracks", 1);
  if (!params_.odometry.refine_camera) return;
  refined_camera_publisher_ =
      handle.advertise<sensor_msgs::CameraInfo>("refined_camera_info", 1, true);
  advertise(private_handle, "save_camera", [this] { return saveCamera(); });
}

/// image_transport: `compressed` is decoded by this class; `raw_or_compressed` subscribes to both,
/// where only one of them is published; any other one but `raw` needs its plugin.
void MonoVoNodelet::subscribe(ros::NodeHandle& handle, const ros::NodeHandle& private_handle,
                              image_transport::ImageTransport* transport) {
  if (params_.camera_file.empty()) {
    camera_info_subscriber_ =
        handle.subscribe("camera_info", kInputQueue, &MonoVoNodelet::onCameraInfo, this);
  }
  const std::string& name = params_.image_transport;
  const bool is_either = name == "raw_or_compressed";
  const image_transport::TransportHints hints(is_either ? "raw" : name,
                                              ros::TransportHints().tcpNoDelay(), private_handle,
                                              is_either ? "no_parameter" : "image_transport");
  if (is_either || name == "compressed") {
    compressed_subscriber_ =
        handle.subscribe(handle.resolveName("image") + "/compressed", kInputQueue,
                         &MonoVoNodelet::onCompressedImage, this, hints.getRosHints());
    if (!is_either) return;
  }
  try {
    image_subscriber_ =
        transport->subscribe("image", kInputQueue, &MonoVoNodelet::onImage, this, hints);
  } catch (const std::exception& error) {
    throw OptionError("parameter image_transport is \"" + name +
                      "\", which cannot be used: " + error.what());
  }
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
  CameraCalibration refined = calibrationOf(odometry_->lens().lens);
  refined.readout_time = params_.odometry.vo.readout_time;
  writeFile(params_.refined_camera_file, cameraYaml(refined, "Refined by MonoVo while driving."));
  return "written to " + params_.refined_camera_file;
}

void MonoVoNodelet::onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  const ros::Time stamp = info->header.stamp;
  if (stamp < newest_info_) useCameraInfos(ros::TIME_MAX);  // the clock jumped back
  newest_info_ = stamp;
  camera_infos_.push_back(info);
  const bool is_full = camera_infos_.size() > kMaxWaitingInfos;
  if (!input_->isReady() || stamp.isZero() || is_full) {
    useCameraInfos(camera_infos_.front()->header.stamp);
  }
  scheduleProcessing();
}

void MonoVoNodelet::useCameraInfos(const ros::Time& until) {
  while (!camera_infos_.empty() && camera_infos_.front()->header.stamp <= until) {
    const sensor_msgs::CameraInfoConstPtr info = camera_infos_.front();
    camera_infos_.pop_front();
    used_info_ = info->header.stamp;
    useCameraInfo(*info);
  }
}

void MonoVoNodelet::useCameraInfo(const sensor_msgs::CameraInfo& info) {
  camera_info_error_.clear();
  try {
    input_->setCameraInfo(fromMsg(info), camera_info_subscriber_.getTopic(), imageTopic());
  } catch (const DataError& error) {
    camera_info_error_ = error.what();
    log_->drop("camera_info refused", camera_info_error_,
               camera_info_error_ == input_->calibrationError());
    return;
  }
  log_->warnOfState(input_->warning());
}

bool MonoVoNodelet::awaitsCameraInfo() const {
  const bool is_full = images_.size() == static_cast<std::size_t>(params_.queue_size);
  return image_has_info_ && !is_full && newest_info_ < images_.front().header.stamp;
}

void MonoVoNodelet::giveUpCameraInfo() {
  image_has_info_ = false;
  scheduleProcessing();
}

void MonoVoNodelet::onCompressedImage(const sensor_msgs::CompressedImageConstPtr& compressed) {
  countInput();
  try {
    store({compressed->header, decode(*compressed), bayerPatternOf(compressed->format), nullptr});
  } catch (const DataError& error) {
    dropImage("image refused", error.what());
  }
}

void MonoVoNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  countInput();
  try {
    store({image->header, pixelsOf(fromMsg(*image)), image->encoding, image});
  } catch (const DataError& error) {
    dropImage("image refused", error.what());
  }
}

void MonoVoNodelet::dropImage(const std::string& kind, const std::string& reason) {
  image_error_ = reason;
  log_->drop(kind, reason);
}

void MonoVoNodelet::store(const ReceivedImage& image) {
  if (images_.size() == static_cast<std::size_t>(params_.queue_size)) {
    images_.pop_front();
    ++dropped_from_queue_;
  }
  images_.push_back(image);
  scheduleProcessing();
}

void MonoVoNodelet::scheduleProcessing() {
  if (processing_scheduled_ || images_.empty() || !input_->isReady()) return;
  if (awaitsCameraInfo()) return info_patience_.start();
  info_patience_.stop();
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
  const ReceivedImage image = images_.front();
  images_.pop_front();
  useCameraInfos(image.header.stamp);
  image_has_info_ = used_info_ == image.header.stamp;
  const cv::Mat grey = greyOf(image);
  if (grey.empty()) return;
  const auto process_image = [=, camera = input_->camera()](bool clock_jumped_back) {
    const Stopwatch watch;  // an image may have been held since it arrived
    process(image, grey, camera, clock_jumped_back);
    countFrame(watch);
  };
  stamp_filter_->add(toNanoseconds(image.header.stamp), process_image);
}

cv::Mat MonoVoNodelet::greyOf(const ReceivedImage& image) {
  cv::Mat grey;
  try {
    grey = input_->grey(image.pixels, image.encoding);
  } catch (const std::exception& error) {
    dropImage("image refused", error.what());
    return {};
  }
  if (input_->isOfCamera(image.header.frame_id)) return grey;
  log_->drop("image of another camera", input_->sourceError(imageTopic()), true);
  return {};
}

void MonoVoNodelet::process(const ReceivedImage& image, const cv::Mat& grey, const Camera& camera,
                            bool clock_jumped_back) {
  std_msgs::Header header = image.header;
  header.frame_id = tfFrame(header.frame_id, "frame_id of the images");
  startOdometry(camera, clock_jumped_back);
  const SelfCalibratingOdometry::Output output =
      odometry_->process(grey, toNanoseconds(header.stamp));
  publish(output, header);
  if (!odometry_->lensContradiction().empty()) {
    log_->error("lens", odometry_->lensContradiction());
  }
  last_frame_ = output.frame;
}

void MonoVoNodelet::startOdometry(const Camera& camera, bool clock_jumped_back) {
  std::string reason;
  if (clock_jumped_back) {
    reason = "the clock jumped back";
  } else if (camera != odometry_camera_ && odometry_camera_) {
    const std::string before = odometry_camera_->describe(), now = camera->describe();
    reason = before == now ? "the frame_id of the images changed"
                           : "camera_info on topic " + camera_info_subscriber_.getTopic() +
                                 " changed from " + before + " to " + now;
  }
  if (odometry_ && reason.empty()) return;
  if (odometry_) NODELET_WARN_STREAM(getName() << ": the odometry is reset: " << reason);
  reset();
  odometry_ = std::make_unique<SelfCalibratingOdometry>(*camera, params_.odometry, input_->mask());
  odometry_camera_ = camera;
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
    points_publisher_.publish(toPointCloud(frame, header, 1));
  }
  if (tracks_publisher_.getNumSubscribers() > 0) {
    tracks_publisher_.publish(paintTracks(
        output.image, frame, last_frame_ ? &*last_frame_ : nullptr, output.rejected, header));
  }
  if (has_other_lens) publishLens(header);
}

/// The calibration of the images as they come.
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

std::string MonoVoNodelet::imageTopic() const {
  return !image_subscriber_ || compressed_subscriber_.getNumPublishers() > 0
             ? compressed_subscriber_.getTopic()
             : image_subscriber_.getTopic();
}

std::string MonoVoNodelet::zoomError() const {
  if (!last_frame_ || last_frame_->zoom == 1) return {};
  return "the focal length has changed by a factor of " + format("%.2f", last_frame_->zoom) +
         " since the start, so there is no scale: fix zoom and focus, or publish camera_info of "
         "the new setting";
}

StageNodelet::State MonoVoNodelet::describe(Diagnostics& status) {
  const VoFrame frame = last_frame_.value_or(VoFrame());
  constexpr std::uint8_t kLevels[] = {DiagnosticStatus::WARN, DiagnosticStatus::OK,
                                      DiagnosticStatus::ERROR};  // as VoStatus
  status.summary(kLevels[static_cast<std::size_t>(frame.status)], toString(frame.status));
  status.add("images received", received());
  status.add("images processed", processed());
  status.add("images dropped, queue full", dropped_from_queue_);
  status.add("map_id", frame.map_id);
  status.add("features", frame.features.size());
  status.add("map points", std::count_if(frame.features.begin(), frame.features.end(),
                                         [](const TrackedFeature& f) { return f.has_point; }));
  State state;
  state.dropped = dropped_from_queue_ + log_->dropped("image ");
  if (!input_->isReady() && !camera_info_error_.empty()) {
    state.errors = {camera_info_error_};
    return state;
  }
  state.missing = missingInput(imageTopic());
  if (state.missing.empty() && !input_->isReady()) {
    state.missing = "no camera_info received yet on " + camera_info_subscriber_.getTopic();
  }
  state.errors = {input_->sourceError(imageTopic()),
                  odometry_ ? odometry_->lensContradiction() : "", zoomError()};
  if (processed() == 0 && !image_error_.empty()) {
    state.errors.push_back("no usable image: " + image_error_);
  }
  for (const std::string& error : state.errors) {
    if (!error.empty()) status.add("wrong input", error);
  }
  state.warnings = {camera_info_error_, input_->warning()};
  return state;
}

}  // namespace gsv

PLUGINLIB_EXPORT_CLASS(gsv::MonoVoNodelet, nodelet::Nodelet)
