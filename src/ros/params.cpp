#include "ros/params.hpp"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <utility>

#include "common/text.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace gsv {
namespace {

using XmlRpc::XmlRpcValue;

std::string inQuotes(const std::string& value) { return "\"" + value + "\""; }

std::string textOf(XmlRpcValue& value) {
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return static_cast<bool>(value) ? "true" : "false";
    case XmlRpcValue::TypeInt:
      return std::to_string(static_cast<int>(value));
    case XmlRpcValue::TypeDouble:
      return format("%.17g", static_cast<double>(value));
    case XmlRpcValue::TypeString:
      return static_cast<std::string>(value);
    default:
      return "a list";
  }
}

/// The values of a tree by `group/name`.
void collectLeaves(XmlRpcValue& tree, const std::string& prefix,
                   std::map<std::string, std::string>* leaves) {
  for (auto& [name, value] : tree) {
    if (value.getType() == XmlRpcValue::TypeStruct) {
      collectLeaves(value, prefix + name + "/", leaves);
    } else {
      leaves->emplace(prefix + name, textOf(value));
    }
  }
}

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
    "use_speed",            // a vehicle with a speed
    "camera_height_sigma",  // the same
    "speed_sigma",
    "speed_scale_sigma",
    "mounting/initial_pitch_sigma",          // a camera mounted with unknown pitch
    "mounting/max_tilt_rad",                 // a camera that looks steeply down
    "direct/lane_half_width_heights",        // a narrow lane or corridor
    "direct/max_ahead_heights",              // a short view ahead
    "trajectory/rotation_sigma_per_sqrt_m",  // covariance for fusion with other sensors
    "trajectory/direction_sigma",            // covariance for fusion with other sensors
};

/// Declares these options of all stages, and any other one that is given, as in config/paper.yaml.
template <typename Options>
void declareOptions(ParamReader& reader, Options& options, const std::vector<std::string>& names) {
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... rest) {
    const bool is_listed = std::find(names.begin(), names.end(), name) != names.end();
    if (is_listed || reader.isGiven(name)) reader.declare(name, field, rest...);
  });
}

void declareClockJump(ParamReader& reader, double& clock_jump_s) {
  reader.declare(
      "clock_jump_s", clock_jump_s, 0.0, 3600.0,
      "[s] a stamp that is earlier than the last one by more than this, or later by more "
      "than this and 1.5 times the last interval, is used only if the next one confirms "
      "it; one earlier by less is dropped");
}

}  // namespace

ParamReader::ParamReader(std::string parameter_namespace, XmlRpcValue tree)
    : namespace_(std::move(parameter_namespace)) {
  if (tree.getType() == XmlRpcValue::TypeStruct) collectLeaves(tree, "", &given_);
}

std::string ParamReader::textOf(double value) { return format("%.10g", value); }

const std::string* ParamReader::find(const std::string& name) const {
  const auto found = given_.find(name);
  return found == given_.end() ? nullptr : &found->second;
}

void ParamReader::declare(const std::string& name, bool& field, const char* meaning) {
  const std::string* const text = find(name);
  if (text) setOptionValue(fullName(name), *text, &field, meaning);
  entries_.push_back({name, field ? "true" : "false", "true or false", meaning, text != nullptr});
}

void ParamReader::declare(const std::string& name, std::string& field, const char* meaning) {
  const std::string* const text = find(name);
  if (text) field = *text;
  entries_.push_back({name, inQuotes(field), "text", meaning, text != nullptr});
}

void ParamReader::declareFrame(const std::string& name, std::string& field, const char* meaning) {
  declare(name, field, meaning);
  const std::string warning = leadingSlashWarning(field, fullName(name));
  if (!warning.empty()) frame_warnings_.push_back(warning);
  field = withoutLeadingSlashes(field);
  entries_.back().value = inQuotes(field);
}

void ParamReader::declareFile(const std::string& name, std::string& field, const char* meaning) {
  declare(name, field, meaning);
  const char* home = std::getenv("HOME");
  if (home == nullptr || field.rfind("~/", 0) != 0) return;
  field.replace(0, 1, home);
  entries_.back().value = inQuotes(field);
}

std::vector<std::string> ParamReader::warnings() const {
  std::vector<std::string> known;
  for (const Entry& entry : entries_) known.push_back(entry.name);
  std::vector<std::string> sentences = frame_warnings_;
  for (const auto& [name, value] : given_) {
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    const std::string nearest = nearestName(name, known);
    sentences.push_back(
        fullName(name) + " is unknown and has no effect" +
        (nearest.empty() ? "" : "; did you mean " + namespace_ + "/" + nearest + "?"));
  }
  return sentences;
}

std::string ParamReader::echo() const {
  std::string lines;
  for (const Entry& entry : entries_) {
    lines += "\n  " + entry.name + " = " + entry.value + "  " + entry.meaning + ", " + entry.range +
             (entry.given ? "" : " (default)");
  }
  return lines;
}

MonoVoParams MonoVoParams::read(ParamReader& reader) {
  MonoVoParams params;
  reader.declare("queue_size", params.queue_size, 1, 1000,
                 "[images] that may wait; a full queue drops the oldest");
  reader.declareFrame("world_frame", params.world_frame, "[] header.frame_id of vo/odometry");
  reader.declare("image_is_rectified", params.image_is_rectified,
                 "[] the images have no distortion and P of camera_info belongs to them");
  reader.declareFile(
      "mask", params.mask,
      "[] image file of the size of the images before rectification: black (0) where "
      "they never show the scene; empty: none");
  reader.declareFile(
      "camera_file", params.camera_file,
      "[] YAML of camera_calibration or calibrate_camera that describes the images as "
      "they come, instead of camera_info and image_is_rectified; empty: camera_info");
  declareClockJump(reader, params.clock_jump_s);
  reader.declare(
      "image_transport", params.image_transport,
      "[] raw, compressed, which the nodelet decodes itself, raw_or_compressed for both, "
      "or the name of another installed plugin of image_transport");
  reader.declareFile("refined_camera_file", params.refined_camera_file,
                     "[] file to which the service save_camera writes the refined calibration, for "
                     "camera_file at the next start");
  params.odometry.refinement.deterministic = false;
  declareOptions(reader, params.odometry, kMonoVoOptions);
  params.readout_time_is_given = reader.isGiven(kReadoutTime);
  return params;
}

ScaleRecoveryParams ScaleRecoveryParams::read(ParamReader& reader) {
  ScaleRecoveryParams params;
  reader.declare("camera_height", params.scale.camera_height, kMinCameraHeight, kMaxCameraHeight,
                 "[m] height of the camera above the road; may be left out with use_speed");
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
  declareClockJump(reader, params.clock_jump_s);
  declareOptions(reader, params.scale, kScaleRecoveryOptions);
  reader.declareFile(
      "height_file", params.height_file,
      "[] file to which the service save_height writes the camera height that was learned from "
      "speeds");
  reader.declare("speed_unit", params.speed_unit,
                 "[] of the topic speed: mps, kmh, mph, knots or mmps; empty: m/s, and messages "
                 "without a stamp are refused");
  if (!params.speed_unit.empty()) speedUnit(params.speed_unit);
  if (params.scale.camera_height == 0 && !params.scale.use_speed) {
    throw OptionError(
        "neither camera_height [m] is set nor use_speed true: the scale needs the height of the "
        "camera above the road, or a speed of the vehicle on the topic speed");
  }
  params.scale.validate();
  if (params.odom_frame.empty()) throw OptionError("parameter odom_frame is empty");
  if (params.odom_frame == params.base_frame) {
    throw OptionError("parameters odom_frame and base_frame are both \"" + params.odom_frame +
                      "\", they must differ");
  }
  return params;
}

}  // namespace gsv
