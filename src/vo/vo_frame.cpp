#include "ground_scale_vo/vo/vo_frame.hpp"

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

}  // namespace ground_scale_vo
