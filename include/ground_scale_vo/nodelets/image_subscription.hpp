#pragma once

#include <image_transport/image_transport.h>
#include <ros/console.h>
#include <ros/node_handle.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <exception>
#include <string>

namespace ground_scale_vo {

/// Subscribes a nodelet to the topic `image` by the transport that its parameter image_transport
/// names. Throws after logging it when that transport is not installed.
template <typename Nodelet>
image_transport::Subscriber subscribeToImages(
    image_transport::ImageTransport& transport, const ros::NodeHandle& private_handle,
    std::uint32_t queue_size, void (Nodelet::*callback)(const sensor_msgs::ImageConstPtr&),
    Nodelet* nodelet, const std::string& nodelet_name) {
  const image_transport::TransportHints hints("raw", ros::TransportHints().tcpNoDelay(),
                                              private_handle);
  try {
    return transport.subscribe("image", queue_size, callback, nodelet, hints);
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM_NAMED(nodelet_name, nodelet_name
                                             << " does not start: parameter image_transport is \""
                                             << hints.getTransport()
                                             << "\", which cannot be used: " << error.what());
    throw;
  }
}

}  // namespace ground_scale_vo
