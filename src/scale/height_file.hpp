#pragma once

#include <string>

namespace ground_scale_vo {

/// An estimate and the half width of its 95 % interval.
struct Interval95 {
  double value = 0, error = 0;
};

/// A YAML file with the parameter camera_height. source: from what it is known. height: [m].
std::string heightYaml(const std::string& source, const Interval95& height);

/// The lines of such a file, comments, with pitch and roll of the camera's mounting [rad]
/// (Mounting) and its transform for tf.
std::string mountingComments(double height, const Interval95& pitch, const Interval95& roll);

}  // namespace ground_scale_vo
