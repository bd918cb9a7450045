// Parameter trees as the nodelets read them.

#include <XmlRpcValue.h>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo::fuzz {
namespace {

using XmlRpc::XmlRpcValue;

/// The parameter names of a nodelet.
template <typename Params>
std::vector<std::string> namesOf() {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  ParamReader reader("fuzz", tree);
  Params::read(reader);
  std::vector<std::string> names;
  for (const ParamReader::Entry& entry : reader.entries()) names.push_back(entry.name);
  return names;
}

/// A random value. depth: largest number of nested lists.
XmlRpcValue value(Input* input, int depth) {
  XmlRpcValue list;
  switch (input->below(depth > 0 ? 6 : 5)) {
    case 0:
      return XmlRpcValue(input->number());
    case 1:
      return XmlRpcValue(input->below(2) ? input->take<int>() : static_cast<int>(input->below(30)));
    case 2:
      return XmlRpcValue(input->take<char>() != 0);
    case 3:
      return XmlRpcValue(input->text(12));
    case 4:
      return XmlRpcValue();
    default:
      list.setSize(static_cast<int>(input->below(4)));
      for (int i = 0; i < list.size(); ++i) list[i] = value(input, depth - 1);
      return list;
  }
}

/// A tree with random values for some of the names, and for a few unknown ones.
XmlRpcValue tree(Input* input, const std::vector<std::string>& names) {
  XmlRpcValue root;
  root["camera_height"] = 1.65;
  while (!input->empty()) {
    const std::string name = input->below(8) == 0 ? input->text(8) : input->oneOf(names);
    const std::size_t slash = name.find('/');
    if (slash == std::string::npos) {
      root[name] = value(input, 3);
      continue;
    }
    XmlRpcValue& group = root[name.substr(0, slash)];
    if (group.valid() && group.getType() != XmlRpcValue::TypeStruct) continue;
    group[name.substr(slash + 1)] = value(input, 2);
  }
  return root;
}

template <typename Params>
void read(const std::uint8_t* data, std::size_t size) {
  static const std::vector<std::string> kNames = namesOf<Params>();
  Input input(data, size);
  const XmlRpcValue root = input.below(50) == 1 ? value(&input, 3) : tree(&input, kNames);
  ParamReader reader("fuzz", root);
  try {
    Params::read(reader);
    for (const ParamReader::Entry& entry : reader.entries()) {
      require(entry.range == "text" || (entry.value.find("nan") == std::string::npos &&
                                        entry.value.find("inf") == std::string::npos),
              "accepted numbers are finite");
    }
  } catch (const OptionError&) {
  }
  reader.warnings();
}

}  // namespace

Plan plan() {
  std::vector<std::string> corpus;
  for (const char fill : {'\0', '\1', '\2', '\7', '\x20'}) corpus.emplace_back(40, fill);
  return {5000, corpus};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ground_scale_vo;
  fuzz::read<MonoVoParams>(data, size);
  fuzz::read<ScaleRecoveryParams>(data, size);
  return 0;
}
