// Parameter trees as the nodelets read them: random values for some of the names, and unknown
// names.

#include <XmlRpcValue.h>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo::fuzz {
namespace {

using XmlRpc::XmlRpcValue;

XmlRpcValue value(Input* input) {
  XmlRpcValue list;
  switch (input->below(5)) {
    case 0:
      return XmlRpcValue(input->number());
    case 1:
      return XmlRpcValue(input->below(2) ? input->take<int>() : static_cast<int>(input->below(30)));
    case 2:
      return XmlRpcValue(input->take<char>() != 0);
    case 3:
      return XmlRpcValue(input->text(12));
    default:
      for (int i = static_cast<int>(input->below(4)) - 1; i >= 0; --i) list[i] = input->number();
      return list;  // not set if it has no elements
  }
}

template <typename Params>
void read(Input input) {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  ParamReader defaults("fuzz", tree);
  Params::read(defaults);
  while (!input.empty()) {
    const std::string name =
        input.below(8) == 0 ? input.text(8) : input.oneOf(defaults.entries()).name;
    const std::size_t slash = name.find('/');
    if (slash == std::string::npos) {
      tree[name] = value(&input);
      continue;
    }
    XmlRpcValue& group = tree[name.substr(0, slash)];
    if (group.valid() && group.getType() != XmlRpcValue::TypeStruct) continue;
    group[name.substr(slash + 1)] = value(&input);
  }
  ParamReader reader("fuzz", tree);
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

void run(const std::string& input) {
  read<MonoVoParams>(Input(input));
  read<ScaleRecoveryParams>(Input(input));
}

}  // namespace ground_scale_vo::fuzz
