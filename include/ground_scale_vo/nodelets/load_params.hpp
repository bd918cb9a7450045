#pragma once

#include <nodelet/nodelet.h>
#include <ros/param.h>

#include <string>

#include "ground_scale_vo/ros/param_reader.hpp"

namespace ground_scale_vo {

/// Reads a nodelet's parameters from its private namespace: echoes those in effect, warns about
/// unknown ones. Throws OptionError after logging it, which makes the manager refuse the nodelet.
template <typename Params>
Params loadParams(const std::string& nodelet_name, const ros::NodeHandle& private_handle) {
  XmlRpc::XmlRpcValue tree;
  ros::param::get(private_handle.getNamespace(), tree);
  ParamReader reader(private_handle.getNamespace(), tree);
  try {
    Params params = Params::read(reader);
    std::string echo;
    for (const ParamReader::Entry& entry : reader.entries()) {
      echo += "\n  " + ParamReader::echo(entry);
    }
    ROS_INFO_STREAM_NAMED(nodelet_name, nodelet_name << " runs with" << echo);
    for (const std::string& sentence : reader.unknown()) {
      ROS_WARN_STREAM_NAMED(nodelet_name, nodelet_name << ": " << sentence);
    }
    return params;
  } catch (const OptionError& error) {
    ROS_FATAL_STREAM_NAMED(nodelet_name, nodelet_name << " does not start: " << error.what());
    throw;
  }
}

}  // namespace ground_scale_vo
