#pragma once

#include <sensor_msgs/distortion_models.h>

#include <algorithm>
#include <string>

namespace ground_scale_vo {

/// Of K, D or P of camera_info: not set.
template <typename Range>
bool allZero(const Range& values) {
  return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

/// True for both names of the fisheye model of OpenCV in camera_info.
inline bool isFisheye(const std::string& distortion_model) {
  return distortion_model == sensor_msgs::distortion_models::EQUIDISTANT ||
         distortion_model == "fisheye";
}

}  // namespace ground_scale_vo
