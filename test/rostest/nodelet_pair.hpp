#pragma once

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>

#include <string>
#include <vector>

#include "manager_client.hpp"
#include "rendered_camera.hpp"

namespace ground_scale_vo {

/// A camera on a rendered drive and both nodelets, in one namespace.
class NodeletPair {
 public:
  /// ns: e.g. "/front", or "" for the root. start_s: stamp of the first image [s].
  NodeletPair(const ManagerClient& manager, const RenderedDrive& drive, const std::string& ns,
              double start_s = 1000)
      : manager_(manager),
        drive_(drive),
        ns_(ns),
        start_s_(start_s),
        images_(handle_.advertise<sensor_msgs::Image>(ns + "/image", 1000)),
        infos_(handle_.advertise<sensor_msgs::CameraInfo>(ns + "/camera_info", 1000, true)),
        frames(handle_, ns + "/vo/frame"),
        scales(handle_, ns + "/scale"),
        odometry(handle_, ns + "/odometry") {
    setParam("scale_recovery", "camera_height", drive.drive().cameraHeight());
  }

  template <typename Value>
  void setParam(const std::string& nodelet, const std::string& name, const Value& value) {
    ros::param::set(ns_ + "/" + nodelet + "/" + name, value);
  }

  bool loadMonoVo() { return manager_.load("MonoVo", ns_ + "/mono_vo"); }
  bool loadScaleRecovery() { return manager_.load("ScaleRecovery", ns_ + "/scale_recovery"); }
  bool load() { return loadMonoVo() && loadScaleRecovery() && waitUntilConnected(); }
  bool unload() {
    return manager_.unload(ns_ + "/mono_vo") && manager_.unload(ns_ + "/scale_recovery");
  }
  /// At least one nodelet is subscribed to the images and one to camera_info. The manager process
  /// is counted once for both nodelets, so the second one may still be missing.
  bool waitForImageSubscribers() {
    return waitUntil(
        [this] { return images_.getNumSubscribers() >= 1 && infos_.getNumSubscribers() >= 1; });
  }
  /// This program is connected to the topics of both nodelets, and waitForImageSubscribers().
  bool waitUntilConnected() {
    return waitForImageSubscribers() && waitUntil([this] {
             return frames.connected() && scales.connected() && odometry.connected();
           });
  }

  std_msgs::Header header(std::size_t i) const { return drive_.header(i, start_s_); }
  void publishInfo(std::size_t i) { publishInfo(*drive_.info(i, start_s_)); }
  void publishInfo(const sensor_msgs::CameraInfo& info) { infos_.publish(info); }
  void publishImage(std::size_t i) { images_.publish(drive_.image(i, start_s_)); }
  void publish(std::size_t i) {
    publishInfo(i);
    publishImage(i);
  }
  /// The results of frame i have been received from both nodelets, which come in either order.
  bool waitForResult(std::size_t i) {
    return frames.waitForStamp(header(i).stamp) && scales.waitForStamp(header(i).stamp);
  }
  /// Publishes the frames one by one, each after the result of the previous one: none is dropped.
  bool play(std::size_t first, std::size_t last) {
    for (std::size_t i = first; i <= last; ++i) {
      publish(i);
      if (!waitForResult(i)) return false;
    }
    return odometry.waitForStamp(header(last).stamp);
  }
  bool playAll() { return play(0, drive_.size() - 1); }

  /// Index of the frame with this stamp.
  std::size_t frameAt(const ros::Time& stamp) const {
    for (std::size_t i = 0; i < drive_.size(); ++i) {
      if (header(i).stamp == stamp) return i;
    }
    throw std::logic_error("no frame has this stamp");
  }
  /// Distance between the first and the last position of an odometry, over the true one. 0 if that
  /// is less than 5 m.
  double displacementRatio(const std::vector<nav_msgs::Odometry::ConstPtr>& messages) const {
    if (messages.size() < 2) return 0;
    const auto position = [](const nav_msgs::Odometry& message) -> Eigen::Vector3d {
      return fromMsg(message.pose.pose).translation();
    };
    const auto& from = drive_.drive().frame(frameAt(messages.front()->header.stamp));
    const auto& to = drive_.drive().frame(frameAt(messages.back()->header.stamp));
    const double true_distance = (to.T_c0_c.translation() - from.T_c0_c.translation()).norm();
    if (true_distance < 5) return 0;
    return (position(*messages.back()) - position(*messages.front())).norm() / true_distance;
  }
  /// Of the odometry received so far.
  double displacementRatio() { return displacementRatio(odometry.messages()); }

 private:
  ros::NodeHandle handle_;
  const ManagerClient manager_;
  const RenderedDrive& drive_;
  const std::string ns_;
  const double start_s_;
  ros::Publisher images_, infos_;

 public:
  TopicRecorder<VoFrameMsg> frames;
  TopicRecorder<ScaleEstimateMsg> scales;
  TopicRecorder<nav_msgs::Odometry> odometry;
};

}  // namespace ground_scale_vo
