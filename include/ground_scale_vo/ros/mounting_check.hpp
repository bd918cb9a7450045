#pragma once

#include <Eigen/Core>
#include <string>

#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// Why the mounting on tf contradicts the road, in one sentence; empty: it does not, or the road's
/// normal is not known well enough yet. Precondition: the camera does not move on the base.
/// up_c: z axis of the base in camera axes, unit, from tf; output: of the latest frame.
std::string mountingContradiction(const std::string& base_frame, const std::string& camera_frame,
                                  const Eigen::Vector3d& up_c, const ScaleRecovery::Output& output);

}  // namespace ground_scale_vo
