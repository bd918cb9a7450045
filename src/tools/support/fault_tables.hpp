#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "ground_scale_vo/simulation/fault_drives.hpp"
#include "ground_scale_vo/simulation/fault_evaluation.hpp"

namespace ground_scale_vo {

/// The drives with these faults alone; without names, all kFaultDriveCount drives with two faults.
/// Throws OptionError.
std::vector<FaultDrive> selectFaultDrives(const std::vector<std::string>& names,
                                          std::uint64_t seed);

/// What is printed about a drive: a heading, and a line for each segment, each fault and the
/// violated threshold. scripts/report_figures.py reads the lines of the faults.
std::string faultDriveText(const FaultDrive& drive, const FaultDriveMetrics& metrics);

struct FaultSummary {
  std::string text;     ///< the last line, with the number of drives that violate a threshold
  int exit_status = 0;  ///< 1 if there is one
};
FaultSummary summarise(const std::vector<FaultDriveMetrics>& drives);

}  // namespace ground_scale_vo
