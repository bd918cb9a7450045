#pragma once

#include <nodelet/nodelet.h>
#include <ros/param.h>

#include <exception>
#include <string>

#include "ground_scale_vo/ros/param_reader.hpp"

namespace ground_scale_vo {

/// Reads a nodelet's parameters from its private namespace, logs those in effect and warns about
/// unknown ones. Throws OptionError.
template <typename Params>
Params loadParams(const std::string& nodelet_name, const ros::NodeHandle& private_handle) {
  XmlRpc::XmlRpcValue tree;
  ros::param::get(private_handle.getNamespace(), tree);
  ParamReader reader(private_handle.getNamespace(), tree);
  Params params = Params::read(reader);
  std::string echo;
  for (const ParamReader::Entry& entry : reader.entries()) {
    echo += "\n  " + ParamReader::echo(entry);
  }
  ROS_INFO_STREAM_NAMED(nodelet_name, nodelet_name << ": parameters" << echo);
  for (const std::string& sentence : reader.warnings()) {
    ROS_WARN_STREAM_NAMED(nodelet_name, nodelet_name << ": " << sentence);
  }
  return params;
}

/// Runs a nodelet's start-up. An exception is logged and passed on, which makes the nodelet manager
/// refuse the nodelet.
template <typename Start>
void startNodelet(const std::string& nodelet_name, Start&& start) {
  try {
    start();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM_NAMED(nodelet_name, nodelet_name << " does not start: " << error.what());
    throw;
  }
}

}  // namespace ground_scale_vo
