#pragma once

#include <string>

#include "ground_scale_vo/ros/param_reader.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"

// The ROS parameters of the nodelets, each under its private namespace. Most options of the core
// are not among them; the offline tools set those (--set NAME=VALUE). docs/reference/parameters.md
// lists both.
namespace ground_scale_vo {

struct MonoVoParams {
  int queue_size = 5;
  bool image_is_rectified = false;
  std::string mask, camera_file;
  std::string image_transport = "raw";
  double clock_jump_s = 1.0;
  std::string world_frame = "vo_world";
  SelfCalibratingOdometry::Options odometry;
  std::string refined_camera_file;
  bool readout_time_is_given = false;  ///< otherwise that of the camera file is used

  /// Throws OptionError that names the parameter.
  static MonoVoParams read(ParamReader& reader);
};

struct ScaleRecoveryParams {
  std::string odom_frame = "odom";
  std::string base_frame;
  bool moving_mount = false;
  bool publish_tf = true;
  int path_max_poses = 5000;
  double path_spacing_m = 0.5;
  int queue_size = 10;
  bool image_is_rectified = false;
  std::string mask, camera_file;
  std::string image_transport = "raw";
  double clock_jump_s = 1.0;
  ScaleRecovery::Options scale;

  /// Throws OptionError that names the parameter.
  static ScaleRecoveryParams read(ParamReader& reader);
};

}  // namespace ground_scale_vo
