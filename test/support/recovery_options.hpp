#pragma once

#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// Default options and the camera height, which is required: that of KITTI.
inline ScaleRecovery::Options recoveryOptions() {
  ScaleRecovery::Options o;
  o.camera_height = 1.65;
  return o;
}

}  // namespace ground_scale_vo
