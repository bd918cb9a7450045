#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// That the mounting is beyond the supported pitch and roll, in one sentence; empty: it is not, or
/// not known well enough yet. output: of the latest frame; turn_axis_c: TurnAxis::upward().
std::string unsupportedMounting(const ScaleRecovery::Output& output,
                                const std::optional<Eigen::Vector3d>& turn_axis_c);

/// Why the mounting on tf contradicts the road, or that it is beyond the supported pitch and roll,
/// in one sentence; empty: neither. Precondition: the camera does not move on the base, and
/// unsupportedMounting() is empty. up_c: z axis of the base in camera axes, unit, from tf.
std::string wrongMountingOnTf(const std::string& base_frame, const std::string& camera_frame,
                              const Eigen::Vector3d& up_c, const ScaleRecovery::Output& output);

}  // namespace ground_scale_vo
