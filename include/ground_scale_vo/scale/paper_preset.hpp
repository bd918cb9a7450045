#pragma once

#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// A copy of options in which the stages make the choices of the paper as printed, as far as these
/// can run. For comparison only.
/// Precondition: options.camera_height > 0.
ScaleRecovery::Options paperPreset(const ScaleRecovery::Options& options);

}  // namespace ground_scale_vo
