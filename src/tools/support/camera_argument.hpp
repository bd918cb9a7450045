#pragma once

#include <string>

#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

constexpr const char* kCameraHelp =
    "calibration of the images as they come (YAML of camera_calibration, plumb_bob), by which they "
    "are undistorted; without it that of the drive";

/// Of --camera FILE; without it (empty) the images have no distortion, as `own` describes them.
/// Throws DataError.
inline CameraCalibration cameraFrom(const std::string& file, const PinholeCamera& own) {
  return file.empty() ? CameraCalibration{own.width, own.height, own.fx, own.fy, own.cx, own.cy}
                      : readCameraFile(file);
}

}  // namespace ground_scale_vo
