#include "ground_scale_vo/ros/params.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "common/text.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {
namespace {

using XmlRpc::XmlRpcValue;

std::string text(double value) {
  std::ostringstream out;
  out.precision(10);
  out << value;
  return out.str();
}

std::string rangeText(double min, double max) { return "[" + text(min) + ", " + text(max) + "]"; }

const char* typeName(const XmlRpcValue& value) {
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return "a boolean";
    case XmlRpcValue::TypeInt:
    case XmlRpcValue::TypeDouble:
      return "a number";
    case XmlRpcValue::TypeString:
      return "a string";
    case XmlRpcValue::TypeArray:
      return "a list";
    case XmlRpcValue::TypeStruct:
      return "a group";
    default:
      return "of an unknown type";
  }
}

void collectLeaves(XmlRpcValue& tree, const std::string& prefix, std::vector<std::string>& leaves) {
  for (auto& member : tree) {
    const std::string name = prefix + member.first;
    if (member.second.getType() == XmlRpcValue::TypeStruct) {
      collectLeaves(member.second, name + "/", leaves);
    } else {
      leaves.push_back(name);
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

/// Declares these options of all stages. Throws std::logic_error if the core has no option of a
/// listed name.
template <typename Options>
void declareOptions(ParamReader& reader, Options& options, const std::vector<std::string>& names) {
  std::size_t declared = 0;
  visitAllParameters(options, [&](const std::string& name, auto& field, auto... rest) {
    if (std::find(names.begin(), names.end(), name) == names.end()) return;
    reader.declare(name.c_str(), field, rest...);
    ++declared;
  });
  if (declared != names.size()) {
    throw std::logic_error("the list of ROS parameters names an option that does not exist");
  }
}

void declareImageParams(ParamReader& reader, ImageParams& params) {
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
  reader.declare(
      "clock_jump_s", params.clock_jump_s, 0.0, 3600.0,
      "[s] a stamp that is earlier than the last one by more than this, or later by more "
      "than this and 1.5 times the last interval, is used only if the next one confirms "
      "it; one earlier by less is dropped");
  reader.declare(
      "image_transport", params.image_transport,
      "[] raw, compressed, which the nodelets decode themselves, raw_or_compressed for both, "
      "or the name of another installed plugin of image_transport");
}

}  // namespace

ParamReader::ParamReader(std::string parameter_namespace, const XmlRpcValue& tree)
    : namespace_(std::move(parameter_namespace)), tree_(tree) {}

XmlRpcValue* ParamReader::find(const std::string& name) {
  XmlRpcValue* node = &tree_;
  std::istringstream parts(name);
  for (std::string part; std::getline(parts, part, '/');) {
    if (node->getType() != XmlRpcValue::TypeStruct || !node->hasMember(part)) return nullptr;
    node = &(*node)[part];
  }
  return node;
}

XmlRpcValue* ParamReader::find(const std::string& name, std::initializer_list<int> types,
                               const std::string& requirement) {
  XmlRpcValue* const given = find(name);
  if (given != nullptr && std::find(types.begin(), types.end(), given->getType()) == types.end()) {
    throw OptionError("parameter " + fullName(name) + " is " + typeName(*given) + ", it must be " +
                      requirement);
  }
  return given;
}

double ParamReader::number(const char* name, double default_value, double min, double max,
                           bool whole, const char* meaning) {
  double value = default_value;
  XmlRpcValue* const given = find(name, {XmlRpcValue::TypeInt, XmlRpcValue::TypeDouble},
                                  "a number in " + rangeText(min, max));
  if (given != nullptr) {
    value = given->getType() == XmlRpcValue::TypeInt ? static_cast<int>(*given)
                                                     : static_cast<double>(*given);
    if (whole && value != std::floor(value)) {
      throw OptionError("parameter " + fullName(name) + " is " + text(value) +
                        ", it must be a whole number in " + rangeText(min, max));
    }
    requireInRange(("parameter " + fullName(name)).c_str(), value, min, max);
  }
  entries_.push_back({name, text(value), rangeText(min, max), meaning, given != nullptr});
  return value;
}

void ParamReader::declare(const char* name, bool& field, const char* meaning) {
  XmlRpcValue* const given = find(name, {XmlRpcValue::TypeBoolean}, "true or false");
  if (given != nullptr) field = static_cast<bool>(*given);
  entries_.push_back({name, field ? "true" : "false", "true or false", meaning, given != nullptr});
}

void ParamReader::declare(const char* name, std::string& field, const char* meaning) {
  XmlRpcValue* const given = find(name, {XmlRpcValue::TypeString}, "a string");
  if (given != nullptr) field = static_cast<std::string>(*given);
  entries_.push_back({name, "\"" + field + "\"", "text", meaning, given != nullptr});
}

void ParamReader::declareFrame(const char* name, std::string& field, const char* meaning) {
  declare(name, field, meaning);
  const std::string warning = leadingSlashWarning(field, "parameter " + fullName(name));
  if (!warning.empty()) frame_warnings_.push_back(warning);
  field = withoutLeadingSlashes(field);
  entries_.back().value = "\"" + field + "\"";
}

void ParamReader::declareFile(const char* name, std::string& field, const char* meaning) {
  declare(name, field, meaning);
  const char* home = std::getenv("HOME");
  if (home == nullptr || field.rfind("~/", 0) != 0) return;
  field.replace(0, 1, home);
  entries_.back().value = "\"" + field + "\"";
}

std::vector<std::string> ParamReader::warnings() const {
  std::vector<std::string> known, leaves;
  for (const Entry& entry : entries_) known.push_back(entry.name);
  XmlRpcValue tree = tree_;
  if (tree.getType() == XmlRpcValue::TypeStruct) collectLeaves(tree, "", leaves);

  std::vector<std::string> sentences = frame_warnings_;
  for (const std::string& leaf : leaves) {
    if (std::find(known.begin(), known.end(), leaf) != known.end()) continue;
    const std::string nearest = nearestName(leaf, known);
    sentences.push_back("parameter " + fullName(leaf) + " is unknown and has no effect" +
                        (nearest.empty() ? "" : "; did you mean " + fullName(nearest) + "?"));
  }
  return sentences;
}

std::string ParamReader::echo(const Entry& entry) {
  return entry.name + " = " + entry.value + "  " + entry.meaning + ", " + entry.range +
         (entry.given ? "" : " (default)");
}

MonoVoParams MonoVoParams::read(ParamReader& reader) {
  MonoVoParams params;
  reader.declare("queue_size", params.queue_size, 1, 1000,
                 "[images] that may wait; a full queue drops the oldest");
  reader.declareFrame("world_frame", params.world_frame, "[] header.frame_id of vo/odometry");
  declareImageParams(reader, params.images);
  reader.declareFile("refined_camera_file", params.refined_camera_file,
                     "[] file to which the service save_camera writes the refined calibration, for "
                     "camera_file at the next start");
  params.odometry.refinement.deterministic = false;
  declareOptions(reader, params.odometry, kMonoVoOptions);
  params.readout_time_is_given =
      std::any_of(reader.entries().begin(), reader.entries().end(),
                  [](const auto& entry) { return entry.name == kReadoutTime && entry.given; });
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
  declareImageParams(reader, params.images);
  declareOptions(reader, params.scale, kScaleRecoveryOptions);
  reader.declareFile(
      "height_file", params.height_file,
      "[] file to which the service save_height writes the camera height that speeds "
      "have taught");
  if (params.scale.camera_height == 0 && !params.scale.use_speed) {
    throw OptionError(
        "neither camera_height [m] is set nor use_speed true: the scale needs the height of the "
        "camera above the road, or a speed of the vehicle on the topic speed");
  }
  if (params.odom_frame.empty()) throw OptionError("parameter odom_frame is empty");
  if (params.odom_frame == params.base_frame) {
    throw OptionError("parameters odom_frame and base_frame are both \"" + params.odom_frame +
                      "\", they must differ");
  }
  params.scale.validate();
  return params;
}

}  // namespace ground_scale_vo
