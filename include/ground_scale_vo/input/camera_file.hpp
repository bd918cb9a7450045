#pragma once

#include <filesystem>
#include <string>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// Reads the calibration of a camera. Formats, told apart by their keys:
///  - YAML of ROS' camera_calibration, also with camera_model in place of distortion_model, and
///    with three keys of this project: estimated_from_drives (true), k1_sigma, readout_time [s].
///    Rectification and projection matrix are not used: a single camera needs none, its undistorted
///    images keep the camera matrix.
///  - Kalibr camchain (the first camera), and sensor.yaml of EuRoC;
///  - OpenCV's YAML (camera_matrix and distortion_coefficients, as its calibration sample writes);
///  - ORB-SLAM (Camera.fx ...; Camera1.fx ...) and VINS (projection_parameters ...);
///  - KITTI calib.txt (P0; the size of the images may be added as S0), calib_cam_to_cam.txt and
///    KITTI-360's perspective.txt (P_rect_00, S_rect_00), and Virtual KITTI's intrinsic.txt, all of
///    rectified images.
/// Throws DataError that names the file, also for another camera model.
CameraCalibration readCameraFile(const std::filesystem::path& file);

/// K, D and S of a camera of a KITTI raw drive before rectification, from calib_cam_to_cam.txt.
/// camera: "00" to "03". rectified: P_rect and S_rect instead. Throws DataError.
CameraCalibration readKittiRawCamera(const std::filesystem::path& file, const std::string& camera,
                                     bool rectified);
/// The camera of rectified images from the 3x4 projection matrix after `key`, row by row, and the
/// size after the same key with S, where there is one.
CameraCalibration readKittiProjection(const std::filesystem::path& file, const std::string& key);

/// YAML of camera_calibration. comment: lines for its head, without '#'.
std::string cameraYaml(const CameraCalibration& camera, const std::string& comment);

}  // namespace gsv
