#include "ground_scale_vo/ros/params.hpp"

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <vector>

#include "ground_scale_vo/common/options.hpp"

namespace ground_scale_vo {
namespace {

constexpr const char* kReadoutTime = "odometry/readout_time";

/// The options of the core that are ROS parameters, by full name.
const std::vector<std::string> kMonoVoOptions = {
    "tracker/cell_size",            // fewer features for a slow machine
    "tracker/min_corner_strength",  // a low-contrast camera
    "bundle_adjustment/window",     // a slow machine
    kReadoutTime,                   // a rolling shutter
    "refine_camera",                // a calibration that may be inaccurate
};
const std::vector<std::string> kScaleRecoveryOptions = {
    "random_seed",
    "refine",
    "mounting/initial_pitch_sigma",          // a camera mounted with unknown pitch
    "mounting/max_tilt_rad",                 // a camera that looks steeply down
    "direct/lane_half_width_heights",        // a narrow lane or corridor
    "direct/max_ahead_heights",              // a short view ahead
    "trajectory/rotation_sigma_per_sqrt_m",  // covariance for fusion with other sensors
    "trajectory/direction_sigma",            // covariance for fusion with other sensors
};

/// Declares these options of all stages; a note tells users of the others how to set them. Throws
/// std::logic_error if the core has no option of a listed name.
template <typename Options>
void declareOptions(ParamReader& reader, Options& options, const std::vector<std::string>& names) {
  std::size_t declared = 0;
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... rest) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      reader.note(name,
                  "is not a ROS parameter and has no effect; the offline tools set it: --set " +
                      name + "=VALUE");
      return;
    }
    reader.declare(name.c_str(), field, rest...);
    ++declared;
  });
  if (declared != names.size()) {
    throw std::logic_error("the list of ROS parameters names an option that does not exist");
  }
}

/// Parameters of both nodelets.
template <typename Params>
void declareCommon(ParamReader& reader, Params& params) {
  reader.declare("image_is_rectified", params.image_is_rectified,
                 "[] the images have no distortion and P of camera_info belongs to them");
  reader.declare("mask", params.mask,
                 "[] image file of the size of the images before rectification: black (0) where "
                 "they never show the scene; empty: none");
  reader.declare("camera_file", params.camera_file,
                 "[] YAML of camera_calibration or calibrate_camera that describes the images as "
                 "they come, instead of camera_info and image_is_rectified; empty: camera_info");
  reader.declare(
      "clock_jump_s", params.clock_jump_s, 0.0, 3600.0,
      "[s] a stamp that is earlier than the last one by more than this, or later by more "
      "than this and 1.5 times the last interval, is used only if the next one confirms "
      "it; one earlier by less is dropped");
  reader.declare("image_transport", params.image_transport,
                 "[] raw, compressed, which the nodelets decode themselves, or the name of another "
                 "installed plugin of image_transport");
}

}  // namespace

MonoVoParams MonoVoParams::read(ParamReader& reader) {
  MonoVoParams params;
  reader.declare("queue_size", params.queue_size, 1, 1000,
                 "[images] that may wait; a full queue drops the oldest");
  reader.declareFrame("world_frame", params.world_frame, "[] header.frame_id of vo/odometry");
  declareCommon(reader, params);
  reader.declare("refined_camera_file", params.refined_camera_file,
                 "[] file to which the service save_camera writes the refined calibration, for "
                 "camera_file at the next start");
  params.odometry.refinement.deterministic = false;
  declareOptions(reader, params.odometry, kMonoVoOptions);
  params.readout_time_is_given =
      std::any_of(reader.entries().begin(), reader.entries().end(),
                  [](const auto& entry) { return entry.name == kReadoutTime && entry.given; });
  params.odometry.validate();
  return params;
}

ScaleRecoveryParams ScaleRecoveryParams::read(ParamReader& reader) {
  ScaleRecoveryParams params;
  reader.require("camera_height", params.scale.camera_height, kMinCameraHeight, kMaxCameraHeight,
                 "[m] height of the camera above the road");
  reader.declareFrame("odom_frame", params.odom_frame, "[] fixed frame of the metric odometry");
  reader.declareFrame("base_frame", params.base_frame,
                      "[] frame whose pose is published; empty: the frame of the images");
  reader.declare("moving_mount", params.moving_mount,
                 "[] look base_frame -> camera up on tf at the stamp of every image; false: once, "
                 "and again after a reset");
  reader.declare("publish_tf", params.publish_tf, "[] broadcast odom_frame -> base_frame on tf");
  reader.declare("path_max_poses", params.path_max_poses, 2, 1000000,
                 "[poses] in path; a full path drops every second one");
  reader.declare("path_spacing_m", params.path_spacing_m, 0.0, 1000.0,
                 "[m] least distance between two poses of path");
  reader.declare("queue_size", params.queue_size, 1, 1000,
                 "[frames] of vo/frame that may wait; a full queue drops the oldest");
  declareCommon(reader, params);
  declareOptions(reader, params.scale, kScaleRecoveryOptions);
  if (params.odom_frame.empty()) throw OptionError("parameter odom_frame is empty");
  if (params.odom_frame == params.base_frame) {
    throw OptionError("parameters odom_frame and base_frame are both \"" + params.odom_frame +
                      "\", they must differ");
  }
  params.scale.validate();
  return params;
}

}  // namespace ground_scale_vo
