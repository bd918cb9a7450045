#pragma once

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>
#include <visualization_msgs/Marker.h>

#include <atomic>
#include <boost/make_shared.hpp>
#include <thread>

#include "graph.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ros/ros_messages.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/drive_run.hpp"

namespace gsv {

/// The camera messages of a rendered drive; each image is rendered once. change: applied to each
/// image, may be empty.
class RenderedDrive {
 public:
  explicit RenderedDrive(const SyntheticDrive::Options& options,
                         const std::string& frame_id = "camera",
                         const std::function<cv::Mat(const cv::Mat&)>& change = {})
      : drive_(options), frame_id_(frame_id) {
    for (std::size_t i = 0; i < drive_.size(); ++i) {
      images_.push_back(change ? change(drive_.image(i)) : drive_.image(i));
    }
  }

  std::size_t size() const { return drive_.size(); }
  const SyntheticDrive& drive() const { return drive_; }
  const SyntheticDrive::Frame& frame(std::size_t i) const { return drive_.frame(i); }
  const cv::Mat& grey(std::size_t i) const { return images_[i]; }

  sensor_msgs::Image::Ptr image(std::size_t i, const ros::Time& stamp) const {
    return toMsg(images_[i], sensor_msgs::image_encodings::MONO8, headerAt(stamp, frame_id_));
  }
  sensor_msgs::CameraInfo::Ptr info(const ros::Time& stamp) const {
    auto info = boost::make_shared<sensor_msgs::CameraInfo>(toCameraInfo(drive_.camera()));
    info->header = headerAt(stamp, frame_id_);
    return info;
  }

 private:
  SyntheticDrive drive_;
  const std::string frame_id_;
  std::vector<cv::Mat> images_;
};

/// A drive with images of 400 x 124, which take a quarter of the time of the default size.
inline SyntheticDrive::Options smallDrive(int frames, double camera_height = 1.65) {
  SyntheticDrive::Options options;
  options.frames = frames;
  options.camera_height = camera_height;
  options.camera = halved(options.camera);
  return options;
}

/// Publishes the drive again and again on `image` and `camera_info`, at about 100 images per
/// second.
class RepeatingCamera {
 public:
  explicit RepeatingCamera(const RenderedDrive& drive)
      : images_(handle_.advertise<sensor_msgs::Image>("image", 10)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>("camera_info", 10)),
        thread_([this, &drive] {
          for (std::size_t n = 0; !stop_; ++n) {
            const ros::Time stamp(1000 + 0.1 * static_cast<double>(n));
            infos_.publish(drive.info(stamp));
            images_.publish(drive.image(n % drive.size(), stamp));
            ros::WallDuration(0.01).sleep();  // the camera's rate
          }
        }) {}
  ~RepeatingCamera() {
    stop_ = true;
    thread_.join();
  }

 private:
  ros::NodeHandle handle_;
  ros::Publisher images_, infos_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Allowed relative deviation of metric distances.
constexpr double kTolerance = 0.05;

/// The topics of a camera and of both nodelets, in one namespace.
class NodeletTopics {
 public:
  /// ns: e.g. "/front", or "" for the root. camera: prefix of `image` and `camera_info`.
  explicit NodeletTopics(const std::string& ns, const std::string& image = "/image",
                         const std::string& camera_info = "/camera_info")
      : images_(handle_.advertise<sensor_msgs::Image>(ns + image, 1000)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>(ns + camera_info, 1000, true)),
        frames(handle_, ns + "/vo/frame"),
        scales(handle_, ns + "/scale"),
        odometry(handle_, ns + "/odometry") {}

  /// This program is connected to the topics of both nodelets, and a nodelet to the camera. The
  /// manager process is counted once for both, so the second one may still be missing.
  bool waitUntilConnected(bool to_camera_info = true) {
    return waitUntil([this, to_camera_info] {
      return images_.getNumSubscribers() > 0 &&
             (infos_.getNumSubscribers() > 0) == to_camera_info && frames.connected() &&
             scales.connected() && odometry.connected();
    });
  }
  /// MonoVo receives images and camera_info from this program, and this program its frames.
  bool waitForMonoVo() {
    return waitUntil([this] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 &&
             frames.connected();
    });
  }
  void publishInfo(const sensor_msgs::CameraInfo& info) { infos_.publish(info); }
  void publishImage(const sensor_msgs::Image& image) { images_.publish(image); }
  /// The results of this image have been received from both nodelets, which come in either order.
  bool waitForStamp(const ros::Time& stamp) {
    return frames.waitForStamp(stamp) && scales.waitForStamp(stamp);
  }
  void clear() {
    frames.clear();
    scales.clear();
    odometry.clear();
  }

 protected:
  ros::NodeHandle handle_;
  ros::Publisher images_, infos_;

 public:
  TopicRecorder<VoFrameMsg> frames;
  TopicRecorder<ScaleEstimateMsg> scales;
  TopicRecorder<nav_msgs::Odometry> odometry;
};

/// Subscribers of the outputs that rviz shows.
struct Display {
  Display(ros::NodeHandle& handle, const std::string& ns)
      : tracks(handle, ns + "/vo/image_tracks"),
        road(handle, ns + "/image_road"),
        vo_points(handle, ns + "/vo/points"),
        points(handle, ns + "/points"),
        ground_points(handle, ns + "/ground_points"),
        path(handle, ns + "/path"),
        plane(handle, ns + "/ground_plane") {}
  bool connected() const {
    return tracks.connected() && road.connected() && vo_points.connected() && points.connected() &&
           ground_points.connected() && path.connected() && plane.connected();
  }
  TopicRecorder<sensor_msgs::Image> tracks, road;
  TopicRecorder<sensor_msgs::PointCloud2> vo_points, points, ground_points;
  TopicRecorder<nav_msgs::Path> path;
  TopicRecorder<visualization_msgs::Marker> plane;
};

/// A camera on a rendered drive and both nodelets, in one namespace. The destructor unloads them.
class NodeletPair : public NodeletTopics {
 public:
  NodeletPair(const ManagerClient& manager, const RenderedDrive& drive, const std::string& ns)
      : NodeletTopics(ns), manager_(manager), drive_(drive), ns_(ns) {
    setParam("scale_recovery", "camera_height", drive.drive().cameraHeight());
  }
  ~NodeletPair() { EXPECT_TRUE(unload()) << ns_; }

  template <typename Value>
  void setParam(const std::string& nodelet, const std::string& name, const Value& value) {
    ros::param::set(ns_ + "/" + nodelet + "/" + name, value);
  }
  bool loadMonoVo() { return load("MonoVo", "/mono_vo"); }
  bool loadScaleRecovery() { return load("ScaleRecovery", "/scale_recovery"); }
  bool load() { return loadMonoVo() && loadScaleRecovery() && waitUntilConnected(); }
  bool unload() {
    bool is_unloaded = true;
    for (const std::string& name : std::exchange(loaded_, {})) {
      is_unloaded = manager_.unload(name) && is_unloaded;
    }
    return is_unloaded;
  }

  ros::Time stamp(std::size_t i) const {
    return ros::Time(start_s) + ros::Duration().fromNSec(drive_.frame(i).stamp_ns);
  }
  ros::Time lastStamp() const { return stamp(drive_.size() - 1); }
  using NodeletTopics::publishImage;
  void publishImage(std::size_t i) { publishImage(i, stamp(i)); }
  void publishImage(std::size_t i, const ros::Time& stamp) {
    images_.publish(drive_.image(i, stamp));
  }
  void publish(std::size_t i) {
    infos_.publish(drive_.info(stamp(i)));
    publishImage(i);
  }
  bool waitForResult(std::size_t i) { return waitForStamp(stamp(i)); }
  bool publishAndWait(std::size_t i) {
    publish(i);
    return waitForResult(i);
  }
  /// Publishes the frames one by one, each after the result of the previous one: none is dropped.
  /// first_is_held: after a jump of the clock the first image has its result after the second one.
  bool play(std::size_t first, std::size_t last, bool first_is_held = false) {
    if (first_is_held) publish(first++);
    for (std::size_t i = first; i <= last; ++i) {
      if (!publishAndWait(i)) return false;
    }
    return true;
  }
  /// The same until the metric pose of the last frame.
  bool playUntilPose(std::size_t first, std::size_t last, bool first_is_held = false) {
    return play(first, last, first_is_held) && odometry.waitForStamp(stamp(last));
  }
  bool playAll() { return playUntilPose(0, drive_.size() - 1); }

  /// Index of the frame with this stamp.
  std::size_t frameAt(const ros::Time& time) const {
    for (std::size_t i = 0; i < drive_.size(); ++i) {
      if (stamp(i) == time) return i;
    }
    throw std::logic_error("no frame has this stamp");
  }
  Eigen::Vector3d truePosition(const ros::Time& time) const {
    return drive_.frame(frameAt(time)).T_c0_c.translation();
  }
  /// Waits for the metric pose of the last frame. The distance between the first and the last
  /// position of the odometry is the true one, of at least 5 m.
  void expectTrueLength(double tolerance = kTolerance) {
    ASSERT_TRUE(odometry.waitForStamp(lastStamp()));
    const nav_msgs::Odometry from = *odometry.first(), to = *odometry.last();
    const double true_distance =
        (truePosition(to.header.stamp) - truePosition(from.header.stamp)).norm();
    EXPECT_GT(true_distance, 5);
    EXPECT_NEAR(
        (fromMsg(to.pose.pose).translation() - fromMsg(from.pose.pose).translation()).norm(),
        true_distance, tolerance * true_distance);
  }

  double start_s = 1000;                                      ///< stamp of the first image [s]
  std::vector<std::pair<std::string, std::string>> remapped;  ///< topics {from, to}

 private:
  bool load(const std::string& type, const std::string& name) {
    if (!manager_.load(type, ns_ + name, remapped)) return false;
    loaded_.push_back(ns_ + name);
    return true;
  }

  const ManagerClient manager_;
  const RenderedDrive& drive_;
  const std::string ns_;
  std::vector<std::string> loaded_;
};

}  // namespace gsv
