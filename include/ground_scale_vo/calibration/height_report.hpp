#pragma once

#include <string>

#include "ground_scale_vo/calibration/height_calibration.hpp"

namespace ground_scale_vo {

/// A YAML file with camera_height [m], for height_file:= of the launch files, and the mounting as
/// comments. source: one sentence on the data. Precondition: result.status is kOk.
std::string heightYaml(const HeightCalibration::Result& result, const std::string& source);

/// A line for each segment of the drive, for the terminal, with times since the start of the first
/// one; empty without segments.
std::string segmentTable(const HeightCalibration::Result& result);

}  // namespace ground_scale_vo
