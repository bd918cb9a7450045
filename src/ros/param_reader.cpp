#include "ground_scale_vo/ros/param_reader.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "ground_scale_vo/common/text.hpp"
#include "ground_scale_vo/ros/frame_name.hpp"

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

double ParamReader::number(const char* name, double default_value, double min, double max,
                           bool whole, const char* meaning) {
  double value = default_value;
  XmlRpcValue* const given = find(name);
  if (given != nullptr) {
    if (given->getType() == XmlRpcValue::TypeInt) {
      value = static_cast<int>(*given);
    } else if (given->getType() == XmlRpcValue::TypeDouble) {
      value = static_cast<double>(*given);
    } else {
      throw OptionError("parameter " + fullName(name) + " is " + typeName(*given) +
                        ", it must be a number in " + rangeText(min, max));
    }
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
  XmlRpcValue* const given = find(name);
  if (given != nullptr) {
    if (given->getType() != XmlRpcValue::TypeBoolean) {
      throw OptionError("parameter " + fullName(name) + " is " + typeName(*given) +
                        ", it must be true or false");
    }
    field = static_cast<bool>(*given);
  }
  entries_.push_back({name, field ? "true" : "false", "true or false", meaning, given != nullptr});
}

void ParamReader::declare(const char* name, std::string& field, const char* meaning) {
  XmlRpcValue* const given = find(name);
  if (given != nullptr) {
    if (given->getType() != XmlRpcValue::TypeString) {
      throw OptionError("parameter " + fullName(name) + " is " + typeName(*given) +
                        ", it must be a string");
    }
    field = static_cast<std::string>(*given);
  }
  entries_.push_back({name, "\"" + field + "\"", "text", meaning, given != nullptr});
}

void ParamReader::declareFrame(const char* name, std::string& field, const char* meaning) {
  declare(name, field, meaning);
  field = frameName(field, "parameter " + fullName(name),
                    [this](const std::string& sentence) { frame_warnings_.push_back(sentence); });
  entries_.back().value = "\"" + field + "\"";
}

void ParamReader::require(const char* name, double& field, double min, double max,
                          const char* meaning) {
  if (find(name) == nullptr) {
    throw OptionError("parameter " + fullName(name) + " is not set and has no default: " + meaning +
                      ", in " + rangeText(min, max));
  }
  declare(name, field, min, max, meaning);
}

std::vector<std::string> ParamReader::warnings() const {
  std::vector<std::string> known;
  for (const Entry& entry : entries_) known.push_back(entry.name);

  std::vector<std::string> leaves;
  XmlRpcValue tree = tree_;
  if (tree.getType() == XmlRpcValue::TypeStruct) collectLeaves(tree, "", leaves);

  std::vector<std::string> sentences = frame_warnings_;
  for (const std::string& leaf : leaves) {
    if (std::find(known.begin(), known.end(), leaf) != known.end()) continue;
    std::string note;
    if (const auto noted = notes_.find(leaf); noted != notes_.end()) {
      note = noted->second;
    } else {
      const std::string nearest = nearestName(leaf, known);
      note = "is unknown and has no effect" +
             (nearest.empty() ? "" : "; did you mean " + fullName(nearest) + "?");
    }
    sentences.push_back("parameter " + fullName(leaf) + " " + note);
  }
  return sentences;
}

std::string ParamReader::echo(const Entry& entry) {
  return entry.name + " = " + entry.value + "  " + entry.meaning + ", " + entry.range +
         (entry.given ? "" : " (default)");
}

}  // namespace ground_scale_vo
