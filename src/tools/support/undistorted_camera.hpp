#pragma once

#include <string>

#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/input/camera_file.hpp"

namespace ground_scale_vo {

constexpr const char* kCameraHelp =
    "calibration of the images as they come (YAML of camera_calibration, plumb_bob), by which they "
    "are undistorted; without it that of the drive";

/// The images of a drive, undistorted by --camera FILE.
struct UndistortedCamera {
  PinholeCamera camera;  ///< of the undistorted images
  Undistortion undistortion;
  double readout_time = 0;  ///< [s]

  explicit UndistortedCamera(const CameraCalibration& c)
      : camera{c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.estimated},
        undistortion(c),
        readout_time(c.readout_time) {}
  /// file: empty: the images have no distortion, as `own` describes them. Throws DataError.
  UndistortedCamera(const std::string& file, const PinholeCamera& own)
      : UndistortedCamera(
            file.empty() ? CameraCalibration{own.width, own.height, own.fx, own.fy, own.cx, own.cy}
                         : readCameraFile(file)) {}
};

}  // namespace ground_scale_vo
