#pragma once

#include <XmlRpc.h>
#include <ros/network.h>
#include <ros/ros.h>
#include <sys/types.h>

#include <string>

namespace ground_scale_vo {

/// The process of a running node, as the node itself says; 0: there is no such node.
inline pid_t processOfNode(const std::string& name) {
  XmlRpc::XmlRpcValue request, response, uri;
  request[0] = ros::this_node::getName();
  request[1] = ros::names::resolve(name);
  if (!ros::master::execute("lookupNode", request, response, uri, false)) return 0;
  std::string host;
  std::uint32_t port = 0;
  if (!ros::network::splitURI(uri, host, port)) return 0;
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  XmlRpc::XmlRpcValue caller, answer;
  caller[0] = ros::this_node::getName();
  if (!client.execute("getPid", caller, answer) || answer.size() != 3) return 0;
  return static_cast<int>(answer[2]);
}

}  // namespace ground_scale_vo
