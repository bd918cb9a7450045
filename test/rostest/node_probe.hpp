#pragma once

#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpc.h>

#include <filesystem>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>

#include "ground_scale_vo/dataset/process_usage.hpp"

namespace ground_scale_vo {

/// A node as the master and the kernel see it.
class NodeProbe {
 public:
  /// Throws std::runtime_error when it does not answer.
  explicit NodeProbe(const std::string& name) : name_(name) {
    XmlRpc::XmlRpcValue request, response, uri, pid;
    request[0] = ros::this_node::getName();
    request[1] = name;
    std::string host;
    std::uint32_t port = 0;
    if (!ros::master::execute("lookupNode", request, response, uri, false) ||
        !ros::network::splitURI(uri, host, port)) {
      throw std::runtime_error("the master does not know " + name);
    }
    XmlRpc::XmlRpcValue caller;
    caller[0] = ros::this_node::getName();
    XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
    if (!client.execute("getPid", caller, pid)) throw std::runtime_error(name + " is silent");
    pid_ = static_cast<int>(pid[2]);
  }

  ProcessUsage usage() const { return processUsage(pid_); }
  std::size_t threads() const {
    const std::filesystem::directory_iterator tasks("/proc/" + std::to_string(pid_) + "/task");
    return static_cast<std::size_t>(std::distance(begin(tasks), end(tasks)));
  }
  /// What the master has of it: "publishes /a", "listens to /b", "serves /c".
  std::set<std::string> registrations() const {
    XmlRpc::XmlRpcValue request, response, state;
    request[0] = ros::this_node::getName();
    if (!ros::master::execute("getSystemState", request, response, state, false)) {
      throw std::runtime_error("the master is silent");
    }
    std::set<std::string> all;
    const char* const kinds[] = {"publishes ", "listens to ", "serves "};
    for (int kind = 0; kind < 3; ++kind) {
      for (int i = 0; i < state[kind].size(); ++i) {
        XmlRpc::XmlRpcValue& nodes = state[kind][i][1];
        for (int k = 0; k < nodes.size(); ++k) {
          if (static_cast<std::string>(nodes[k]) == name_) {
            all.insert(kinds[kind] + static_cast<std::string>(state[kind][i][0]));
          }
        }
      }
    }
    return all;
  }

 private:
  std::string name_;
  pid_t pid_ = 0;
};

}  // namespace ground_scale_vo
