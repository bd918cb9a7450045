#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo {
namespace {

/// Reads what a stage's Options describe, under group ("tracker/", or empty).
template <typename Options>
void declareStage(ParamReader& reader, const std::string& group, Options& options) {
  Options::describe(options, [&](const char* name, auto& field, auto... rest) {
    reader.declare((group + name).c_str(), field, rest...);
  });
}

void declareOptions(ParamReader& reader, VisualOdometry::Options& options) {
  declareStage(reader, "tracker/", options.tracker);
  declareStage(reader, "two_view/", options.two_view);
  declareStage(reader, "alignment/", options.alignment);
  declareStage(reader, "pose/", options.pose);
  declareStage(reader, "map/", options.map);
  declareStage(reader, "bundle_adjustment/", options.bundle_adjustment);
  declareStage(reader, "odometry/", options);
}

void declareOptions(ParamReader& reader, ScaleRecovery::Options& options) {
  reader.require("camera_height", options.camera_height, 0.05, 100.0,
                 "[m] height of the camera above the road");
  reader.declare("random_seed", options.random_seed, 0, 2147483647, "[] seed of all random draws");
  declareStage(reader, "", options);
  declareStage(reader, "motion/", options.motion);
  declareStage(reader, "mounting/", options.mounting);
  declareStage(reader, "gpe/", options.gpe);
  declareStage(reader, "gpa/", options.gpa);
  declareStage(reader, "fit/", options.gpa.fit);
  declareStage(reader, "refinement/", options.refinement);
  declareStage(reader, "filter/", options.filter);
  declareStage(reader, "trajectory/", options.trajectory);
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
  declareOptions(reader, params.vo);
  params.vo.validate();
  return params;
}

ScaleRecoveryParams ScaleRecoveryParams::read(ParamReader& reader) {
  ScaleRecoveryParams params;
  declareOptions(reader, params.scale);
  reader.declare("odom_frame", params.odom_frame, "[] the metric odometry's fixed frame");
  reader.declare("base_frame", params.base_frame,
                 "[] the frame whose pose is published; empty: the image's frame");
  reader.declare("publish_tf", params.publish_tf, "[] broadcast odom_frame -> base_frame");
  reader.declare("path_max_poses", params.path_max_poses, 2, 1000000,
                 "[poses] in path; when it is full every second one goes");
  reader.declare("path_spacing_m", params.path_spacing_m, 0.0, 1000.0,
                 "[m] least distance between two poses of path");
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
