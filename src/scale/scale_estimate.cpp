#include "ground_scale_vo/scale/scale_estimate.hpp"

namespace ground_scale_vo {

const char* toString(ScaleStatus status) {
  switch (status) {
    case ScaleStatus::kUnknown:
      return "unknown";
    case ScaleStatus::kOk:
      return "ok";
    case ScaleStatus::kHeld:
      return "held";
  }
  return "invalid";
}

const char* toString(ScaleReason reason) {
  switch (reason) {
    case ScaleReason::kNone:
      return "none";
    case ScaleReason::kVoNotTracking:
      return "vo_not_tracking";
    case ScaleReason::kStandstill:
      return "standstill";
    case ScaleReason::kTooFewTriangles:
      return "too_few_triangles";
    case ScaleReason::kTooFewGroundPoints:
      return "too_few_ground_points";
    case ScaleReason::kNoPlane:
      return "no_plane";
    case ScaleReason::kPlaneTilted:
      return "plane_tilted";
    case ScaleReason::kRejectedByFilter:
      return "rejected_by_filter";
    case ScaleReason::kImplausibleMotion:
      return "implausible_motion";
  }
  return "invalid";
}

}  // namespace ground_scale_vo
