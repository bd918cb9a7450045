#include "ground_scale_vo/ros/params.hpp"

#include "ground_scale_vo/common/options.hpp"

namespace ground_scale_vo {
namespace {

/// Reads what all stages describe.
template <typename Options>
void declareStages(ParamReader& reader, Options& options) {
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... rest) {
    reader.declare(name.c_str(), field, rest...);
  });
}

/// What both nodelets have, and what libraries read beside us.
void declareCommon(ParamReader& reader, bool& image_is_rectified, double& clock_jump_s) {
  reader.declare("image_is_rectified", image_is_rectified,
                 "[] the images have no distortion and P of camera_info belongs to them");
  reader.declare(
      "clock_jump_s", clock_jump_s, 0.0, 3600.0,
      "[s] a stamp that lies farther back than this starts anew; a nearer one is dropped");
  reader.allow("diagnostic_period");
  reader.allow("image_transport");
}

}  // namespace

MonoVoParams MonoVoParams::read(ParamReader& reader) {
  MonoVoParams params;
  reader.declare("queue_size", params.queue_size, 1, 1000,
                 "[images] that may wait; when it is full the oldest is dropped");
  reader.declare("world_frame", params.world_frame, "[] header.frame_id of vo/odometry");
  declareCommon(reader, params.image_is_rectified, params.clock_jump_s);
  declareStages(reader, params.vo);
  params.vo.validate();
  return params;
}

ScaleRecoveryParams ScaleRecoveryParams::read(ParamReader& reader) {
  ScaleRecoveryParams params;
  reader.require("camera_height", params.scale.camera_height, 0.05, 100.0,
                 "[m] height of the camera above the road");
  declareStages(reader, params.scale);
  reader.declare("odom_frame", params.odom_frame, "[] the metric odometry's fixed frame");
  reader.declare("base_frame", params.base_frame,
                 "[] the frame whose pose is published; empty: the image's frame");
  reader.declare("publish_tf", params.publish_tf, "[] broadcast odom_frame -> base_frame");
  reader.declare("path_max_poses", params.path_max_poses, 2, 1000000,
                 "[poses] in path; when it is full every second one goes");
  reader.declare("path_spacing_m", params.path_spacing_m, 0.0, 1000.0,
                 "[m] least distance between two poses of path");
  reader.declare("queue_size", params.queue_size, 1, 1000,
                 "[frames] of vo/frame that may wait; when it is full the oldest is dropped");
  reader.declare("image_buffer", params.image_buffer, 1, 10000,
                 "[images] kept until their vo/frame comes; when it is full the oldest goes");
  declareCommon(reader, params.image_is_rectified, params.clock_jump_s);
  if (params.odom_frame.empty()) throw OptionError("parameter odom_frame is empty");
  if (params.odom_frame == params.base_frame) {
    throw OptionError("parameters odom_frame and base_frame are both \"" + params.odom_frame +
                      "\", they must differ");
  }
  params.scale.validate();
  return params;
}

}  // namespace ground_scale_vo
