#pragma once

#include <string>

#include "command_line.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"

namespace ground_scale_vo {

/// Adds --camera, --mask, --fps and --unrectified.
void addDriveOptions(DriveInput* input, po::options_description* options);

/// Prints the warnings, the failure and the summary of a run. Returns the exit status.
int report(const std::string& name, const DriveRun& run, const std::string& folder, bool is_strict);

}  // namespace ground_scale_vo
