#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <type_traits>
#include <vector>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {

/// Reads the parameters under one namespace into the fields that they belong to.
///
/// Every parameter is declared once, with the field (its value before is the default), its range
/// and a text "[unit] meaning". What is declared is also what is known: unknown() and entries()
/// follow from it. Needs no master: the tree is handed in.
class ParamReader {
 public:
  struct Entry {
    std::string name;     ///< below the namespace, `group/name`
    std::string value;    ///< in effect
    std::string range;    ///< "[min, max]", "true or false", "text"
    std::string meaning;  ///< "[unit] meaning"
    bool given = false;   ///< the tree holds it
  };

  /// parameter_namespace: only for messages. tree: all below it; not a struct means empty.
  ParamReader(std::string parameter_namespace, const XmlRpc::XmlRpcValue& tree);

  /// A number. Throws OptionError that names the parameter when it is no number or outside
  /// [min, max]; NaN is always outside.
  template <typename Number>
  void declare(const char* name, Number& field, double min, double max, const char* meaning) {
    static_assert(std::is_arithmetic_v<Number> && !std::is_same_v<Number, bool>);
    field = static_cast<Number>(
        number(name, static_cast<double>(field), min, max, std::is_integral_v<Number>, meaning));
  }
  void declare(const char* name, bool& field, const char* meaning);
  void declare(const char* name, std::string& field, const char* meaning);

  /// A number that has no default: throws OptionError when it is not given.
  void require(const char* name, double& field, double min, double max, const char* meaning);

  /// A name that another library reads under the same namespace (diagnostic_period, ...).
  void allow(const char* name) { allowed_.emplace_back(name); }

  /// One sentence for each given key that nobody declared, with the nearest known name.
  std::vector<std::string> unknown() const;

  /// All that was declared, in that order.
  const std::vector<Entry>& entries() const { return entries_; }
  /// "name = value  [unit] meaning, range" of an entry, for the log.
  static std::string echo(const Entry& entry);

 private:
  double number(const char* name, double default_value, double min, double max, bool whole,
                const char* meaning);
  XmlRpc::XmlRpcValue* find(const std::string& name);
  std::string fullName(const std::string& name) const { return namespace_ + "/" + name; }

  std::string namespace_;
  XmlRpc::XmlRpcValue tree_;
  std::vector<Entry> entries_;
  std::vector<std::string> allowed_;
};

}  // namespace ground_scale_vo
