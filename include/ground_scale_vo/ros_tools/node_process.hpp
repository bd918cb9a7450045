#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

namespace ground_scale_vo {

/// The process of a ROS node, as the node itself says; empty when the master does not know it or it
/// does not answer. Of use on the machine that it runs on.
std::optional<pid_t> processOf(const std::string& node);

}  // namespace ground_scale_vo
