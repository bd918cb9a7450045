#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <string>

namespace ground_scale_vo {

/// Why image_is_rectified contradicts K, D, R and P of camera_info or the name of the image topic,
/// in one sentence; empty: it does not, or there is nothing to compare. A hint, not a proof: P may
/// describe any rectification. Precondition: CalibratedCamera accepts the info.
std::string rectificationContradiction(const sensor_msgs::CameraInfo& info, bool image_is_rectified,
                                       const std::string& image_topic);

}  // namespace ground_scale_vo
