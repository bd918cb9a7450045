#pragma once

#include <string>
#include <vector>

#include "command_line.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"

namespace gsv {

/// The arguments of the tools that run the odometry over a drive: SEQ, --camera-height, --out,
/// --options, --set, --camera, --mask, --fps and --unrectified.
struct DriveArguments {
  DriveInput drive;
  std::string out;
  MetricOdometry::Options options;
  std::string options_file;           ///< of --options
  std::vector<std::string> settings;  ///< of --set
  /// Speeds of the vehicle, which replace --camera-height; empty: none. For an option of the tool.
  std::string speed_file;
  std::string speed_unit;
  double speed_offset = 0;  ///< [s]

  /// out_help: of --out.
  void addTo(CommandLine* command_line, const std::string& out_help);
  /// Applies and validates the options. Throws OptionError.
  void check();
};

}  // namespace gsv
