#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <initializer_list>
#include <string>
#include <type_traits>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/self_calibrating_odometry.hpp"

namespace ground_scale_vo {

/// Reads the ROS parameters under one namespace into fields.
///
/// Each parameter is declared once, with its field (whose value is the default), its range and a
/// text "[unit] meaning". The list of known names, the log and the documentation follow from these
/// declarations. Works on a parameter tree, without a ROS master.
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
  ParamReader(std::string parameter_namespace, const XmlRpc::XmlRpcValue& tree);

  /// A number. Throws OptionError that names the parameter if its value is not a number, not whole
  /// for an integer field, or outside [min, max]; NaN is always outside.
  template <typename Number>
  void declare(const char* name, Number& field, double min, double max, const char* meaning) {
    static_assert(std::is_arithmetic_v<Number> && !std::is_same_v<Number, bool>);
    field = static_cast<Number>(
        number(name, static_cast<double>(field), min, max, std::is_integral_v<Number>, meaning));
  }
  void declare(const char* name, bool& field, const char* meaning);
  void declare(const char* name, std::string& field, const char* meaning);

  /// The name of a tf frame, without leading slashes; warnings() reports one that has them.
  void declareFrame(const char* name, std::string& field, const char* meaning);
  /// The path of a file; ~/ at its beginning is the home folder (roslaunch does not expand it).
  void declareFile(const char* name, std::string& field, const char* meaning);

  /// One sentence for each frame name with a slash, and for each parameter that is set but not
  /// declared, with the most similar known name.
  std::vector<std::string> warnings() const;

  /// All declared parameters, in order.
  const std::vector<Entry>& entries() const { return entries_; }
  /// "name = value  [unit] meaning, range" of an entry, and " (default)" if it is not set, for the
  /// log.
  static std::string echo(const Entry& entry);

 private:
  double number(const char* name, double default_value, double min, double max, bool whole,
                const char* meaning);
  XmlRpc::XmlRpcValue* find(const std::string& name);
  /// Throws OptionError if it has none of these types.
  XmlRpc::XmlRpcValue* find(const std::string& name, std::initializer_list<int> types,
                            const std::string& requirement);
  std::string fullName(const std::string& name) const { return namespace_ + "/" + name; }

  std::string namespace_;
  XmlRpc::XmlRpcValue tree_;
  std::vector<Entry> entries_;
  std::vector<std::string> frame_warnings_;
};

// The ROS parameters of the nodelets, each under its private namespace. Most options of the core
// are not among them; the offline tools set those (--set NAME=VALUE). docs/reference/parameters.md
// lists both.

/// How both nodelets receive images and check stamps.
struct ImageParams {
  bool image_is_rectified = false;
  std::string mask, camera_file;
  std::string image_transport = "raw";
  double clock_jump_s = 1.0;
};

struct MonoVoParams {
  ImageParams images;
  int queue_size = 5;
  std::string world_frame = "vo_world";
  SelfCalibratingOdometry::Options odometry;
  std::string refined_camera_file;
  bool readout_time_is_given = false;  ///< otherwise the camera file's is used

  /// Throws OptionError that names the parameter.
  static MonoVoParams read(ParamReader& reader);
};

struct ScaleRecoveryParams {
  ImageParams images;
  int queue_size = 10;
  std::string odom_frame = "odom";
  std::string base_frame;
  bool moving_mount = false;
  bool publish_tf = true;
  int path_max_poses = 5000;
  double path_spacing_m = 0.5;
  std::string height_file;
  ScaleRecovery::Options scale;

  /// Throws OptionError that names the parameter.
  static ScaleRecoveryParams read(ParamReader& reader);
};

}  // namespace ground_scale_vo
