#pragma once

#include <ros/master.h>
#include <ros/this_node.h>
#include <xmlrpcpp/XmlRpc.h>

#include <filesystem>
#include <iterator>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>

#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/ros_tools/node_process.hpp"

namespace ground_scale_vo {

/// Registrations of a node at the master, and its process.
class NodeProbe {
 public:
  /// Throws std::runtime_error when the node is not registered or does not answer.
  explicit NodeProbe(const std::string& name) : name_(name) {
    const std::optional<pid_t> pid = processOf(name);
    if (!pid) throw std::runtime_error(name + " does not answer");
    pid_ = *pid;
  }

  ProcessUsage usage() const { return processUsage(pid_); }
  std::size_t threads() const {
    const std::filesystem::directory_iterator tasks("/proc/" + std::to_string(pid_) + "/task");
    return static_cast<std::size_t>(std::distance(begin(tasks), end(tasks)));
  }
  /// At the master: "publishes /a", "subscribes to /b", "serves /c".
  std::set<std::string> registrations() const {
    XmlRpc::XmlRpcValue request, response, state;
    request[0] = ros::this_node::getName();
    if (!ros::master::execute("getSystemState", request, response, state, false)) {
      throw std::runtime_error("the master does not answer");
    }
    std::set<std::string> all;
    const char* const kinds[] = {"publishes ", "subscribes to ", "serves "};
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
