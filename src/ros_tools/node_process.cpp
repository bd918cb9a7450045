#include "ground_scale_vo/ros_tools/node_process.hpp"

#include <ros/master.h>
#include <ros/names.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include <cstdint>

namespace gsv {

std::optional<XmlRpc::XmlRpcValue> callNode(const std::string& node, const std::string& method) {
  XmlRpc::XmlRpcValue request, response, uri;
  request[0] = ros::this_node::getName();
  request[1] = ros::names::resolve(node);
  std::string host;
  std::uint32_t port = 0;
  constexpr bool kWaitForMaster = false;
  if (!ros::master::execute("lookupNode", request, response, uri, kWaitForMaster) ||
      !ros::network::splitURI(uri, host, port)) {
    return std::nullopt;
  }
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  XmlRpc::XmlRpcValue self, answer;
  self[0] = ros::this_node::getName();
  if (!client.execute(method.c_str(), self, answer) || answer.size() < 3) return std::nullopt;
  return answer[2];
}

std::optional<pid_t> processOf(const std::string& node) {
  std::optional<XmlRpc::XmlRpcValue> pid = callNode(node, "getPid");
  if (!pid) return std::nullopt;
  return static_cast<int>(*pid);
}

}  // namespace gsv
