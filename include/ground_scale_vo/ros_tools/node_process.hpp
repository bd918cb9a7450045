#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

namespace ground_scale_vo {

/// Process id of a ROS node, as reported by the node; empty if it is not registered or its process
/// is gone. Blocks while the process does not answer. Meaningful on the machine of the node only.
std::optional<pid_t> processOf(const std::string& node);

}  // namespace ground_scale_vo
