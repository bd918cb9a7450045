#pragma once

#include "ground_scale_vo/scale/scale_recovery.hpp"

namespace ground_scale_vo {

/// Default options with the required camera height.
inline ScaleRecovery::Options options() {
  ScaleRecovery::Options o;
  o.camera_height = 1.65;
  return o;
}

}  // namespace ground_scale_vo
