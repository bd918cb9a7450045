#include "ground_scale_vo/vo/vo_frame.hpp"

#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {

const char* toString(VoStatus status) {
  switch (status) {
    case VoStatus::kInitialising:
      return "initialising";
    case VoStatus::kTracking:
      return "tracking";
    case VoStatus::kLost:
      return "lost";
  }
  return "invalid";
}

bool hasUsablePoint(const TrackedFeature& feature) {
  return feature.has_point && isPlausiblePosition(feature.p_c) && feature.p_c.z() > 0 &&
         feature.depth_sigma >= 0 && feature.depth_sigma <= kLargestCoordinate;
}

}  // namespace ground_scale_vo
