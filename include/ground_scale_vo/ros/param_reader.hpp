#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include "ground_scale_vo/common/error.hpp"

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

  /// The name of a tf frame, without leading slashes (frameName()); warnings() reports one.
  void declareFrame(const char* name, std::string& field, const char* meaning);

  /// A number without a default: throws OptionError if it is not set.
  void require(const char* name, double& field, double min, double max, const char* meaning);

  /// A name that is not a parameter. If it is set, warnings() contains "parameter NAME <note>".
  void note(const std::string& name, const std::string& note) { notes_[name] = note; }

  /// One sentence for each frame name with a slash, and for each parameter that is set but not
  /// declared: its note, or else the most similar known name.
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
  std::string fullName(const std::string& name) const { return namespace_ + "/" + name; }

  std::string namespace_;
  XmlRpc::XmlRpcValue tree_;
  std::vector<Entry> entries_;
  std::map<std::string, std::string> notes_;
  std::vector<std::string> frame_warnings_;
};

}  // namespace ground_scale_vo
