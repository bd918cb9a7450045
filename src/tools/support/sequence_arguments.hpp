#pragma once

#include <string>
#include <vector>

#include "command_line.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"

namespace ground_scale_vo {

/// --set GROUP/NAME=VALUE, any number of times.
inline po::typed_value<std::vector<std::string>>* settingsValue(std::vector<std::string>* target) {
  return po::value(target)->composing()->value_name("GROUP/NAME=VALUE");
}
constexpr const char* kSettingsHelp =
    "sets an option to a value other than its default (docs/reference/parameters.md); may be "
    "repeated";

/// The common arguments of run_sequence and benchmark_sequence: SEQ, --camera-height, --out, --set.
struct SequenceArguments {
  std::string sequence, out;
  OfflineRun::Options options;
  std::vector<std::string> settings;  ///< of --set

  /// out_help: of --out.
  void addTo(CommandLine* command_line, const std::string& out_help);
  /// Applies and validates the options. Throws OptionError.
  void check();
};

}  // namespace ground_scale_vo
