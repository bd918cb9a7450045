#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"

namespace gsv {

/// [messages] that wait for a slow subscriber of a topic with one message per image: ten seconds of
/// a 10 Hz camera.
constexpr std::uint32_t kPublishQueue = 100;

/// Reads the ROS parameters under one namespace into fields, whose values are the defaults. Each is
/// declared once; the list of known names, the log and the documentation follow from that.
class ParamReader {
 public:
  struct Entry {
    std::string name;     ///< below the namespace, `group/name`
    std::string value;    ///< in effect
    std::string range;    ///< "[min, max]", "true or false", "text"
    std::string meaning;  ///< "[unit] meaning"
    bool given = false;   ///< set in the tree
  };

  /// parameter_namespace: for messages. tree: all parameters below it; any other type than a struct
  /// means none.
  ParamReader(std::string parameter_namespace, XmlRpc::XmlRpcValue tree);

  /// A number. Throws OptionError that names the parameter, as setOption().
  template <typename Number>
  void declare(const std::string& name, Number& field, double min, double max,
               const char* meaning) {
    const std::string* const text = find(name);
    if (text) setOptionValue(fullName(name), *text, &field, min, max, meaning);
    entries_.push_back({name, textOf(static_cast<double>(field)),
                        "[" + textOf(min) + ", " + textOf(max) + "]", meaning, text != nullptr});
  }
  void declare(const std::string& name, bool& field, const char* meaning);
  void declare(const std::string& name, std::string& field, const char* meaning);

  /// The name of a tf frame, without leading slashes; warnings() reports one that has them.
  void declareFrame(const std::string& name, std::string& field, const char* meaning);
  /// The path of a file; ~/ at its beginning is the home folder (roslaunch does not expand it).
  void declareFile(const std::string& name, std::string& field, const char* meaning);

  /// One sentence for each frame name with a slash, and for each parameter that is set but not
  /// declared, with the most similar known name.
  std::vector<std::string> warnings() const;

  bool isGiven(const std::string& name) const { return find(name) != nullptr; }
  /// All declared parameters, in order.
  const std::vector<Entry>& entries() const { return entries_; }
  /// For the log, a line for each: "name = value  [unit] meaning, range", and " (default)" if it is
  /// not set.
  std::string echo() const;

 private:
  static std::string textOf(double value);
  /// The value as text; null: it is not set.
  const std::string* find(const std::string& name) const;
  std::string fullName(const std::string& name) const {
    return "parameter " + namespace_ + "/" + name;
  }

  std::string namespace_;
  std::map<std::string, std::string> given_;  ///< values by name below the namespace
  std::vector<Entry> entries_;
  std::vector<std::string> frame_warnings_;
};

struct MonoVoParams {
  int queue_size = 5;
  std::string world_frame = "vo_world";
  bool image_is_rectified = false;
  std::string mask, camera_file;
  double clock_jump_s = 1.0;
  std::string image_transport = "raw";
  std::string refined_camera_file;
  SelfCalibratingOdometry::Options odometry;
  bool readout_time_is_given = false;  ///< otherwise the camera file's is used

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
  double clock_jump_s = 1.0;
  std::string height_file;
  std::string speed_unit;
  ScaleRecovery::Options scale;

  /// Throws OptionError that names the parameter.
  static ScaleRecoveryParams read(ParamReader& reader);
};

}  // namespace gsv
