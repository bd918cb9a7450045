#pragma once

#include <functional>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/set_option.hpp"

namespace ground_scale_vo {

/// What every command over one KITTI folder takes: SEQ, --camera-height, --out and --set.
struct SequenceArguments {
  std::string sequence, out;
  OfflineRun::Options options;

  /// The value of the option at hand. Throws OptionError when there is none.
  using Value = std::function<std::string()>;

  /// Reads them and what the command takes besides: own(argument, value) does that and returns
  /// true, or false when it does not know the argument. Throws OptionError.
  void parse(int argc, char** argv,
             const std::function<bool(const std::string& argument, const Value& value)>& own) {
    bool has_height = false;
    for (int i = 1; i < argc; ++i) {
      const std::string argument = argv[i];
      const Value value = [&] {
        if (++i == argc) throw OptionError(argument + " needs a value");
        return std::string(argv[i]);
      };
      if (argument == "--camera-height") {
        options.scale.camera_height = parseNumber(argument, value());
        has_height = true;
      } else if (argument == "--out") {
        out = value();
      } else if (own(argument, value)) {
        continue;
      } else if (argument == "--set") {
        setOption(options, value());
      } else if (argument.size() > 1 && argument.front() == '-') {
        throw OptionError(argument + " is not an option, see --help");
      } else if (!sequence.empty()) {
        throw OptionError("one sequence at a time, not " + sequence + " and " + argument);
      } else {
        sequence = argument;
      }
    }
    if (sequence.empty()) throw OptionError("SEQ is missing, see --help");
    if (!has_height) throw OptionError("--camera-height is missing, there is no default");
    if (out.empty()) throw OptionError("--out is missing, see --help");
    options.validate();
  }
};

}  // namespace ground_scale_vo
