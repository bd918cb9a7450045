#pragma once

#include <sys/types.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <optional>
#include <string>

namespace gsv {

/// Result of a method of the slave API of a ROS node that takes no further argument, such as
/// getBusInfo; empty if the node is not registered or its process is gone. Blocks while the process
/// does not answer.
std::optional<XmlRpc::XmlRpcValue> callNode(const std::string& node, const std::string& method);

/// Process id of a ROS node, as reported by the node; empty if it is not registered or its process
/// is gone. Blocks like callNode(). Meaningful on the machine of the node only.
std::optional<pid_t> processOf(const std::string& node);

}  // namespace gsv
