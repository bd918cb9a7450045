#pragma once

#include <nav_msgs/Odometry.h>
#include <sensor_msgs/Image.h>

#include <iostream>
#include <string>

#include "ground_scale_vo/ros/messages.hpp"
#include "topic_recorder.hpp"

namespace ground_scale_vo {

/// With this argument and a namespace the program is the subscriber that overload_rostest stalls.
const char* const kSubscribe = "--subscribe";

/// Subscribes to topics of the nodelets in a namespace, prints kSubscribe once it is connected, and
/// runs until it is stopped. Returns the exit status.
inline int subscribe(const std::string& ns) {
  ros::NodeHandle handle;
  TopicRecorder<VoFrameMsg> frames(handle, ns + "/vo/frame");
  TopicRecorder<sensor_msgs::Image> tracks(handle, ns + "/vo/image_tracks");
  TopicRecorder<nav_msgs::Odometry> odometry(handle, ns + "/odometry");
  if (!waitUntil(
          [&] { return frames.connected() && tracks.connected() && odometry.connected(); })) {
    return 1;
  }
  std::cout << kSubscribe << std::endl;
  ros::waitForShutdown();
  return 0;
}

}  // namespace ground_scale_vo
