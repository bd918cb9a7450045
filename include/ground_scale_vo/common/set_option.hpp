#pragma once

#include <string>

#include "ground_scale_vo/metric_odometry.hpp"

namespace ground_scale_vo {

/// Sets one option by the name of its ROS parameter: "group/name=value", a bool as true or false.
/// camera_height is not among them. Throws OptionError that names the option: none of this name
/// (with the nearest one), no number, no whole one where it counts something, outside its range.
void setOption(MetricOdometry::Options& options, const std::string& assignment);

}  // namespace ground_scale_vo
