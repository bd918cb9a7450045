#include "ground_scale_vo/scale/scale_estimate.hpp"

namespace ground_scale_vo {

const char* toString(ScaleSource source) {
  switch (source) {
    case ScaleSource::kNone:
      return "none";
    case ScaleSource::kRoad:
      return "road";
    case ScaleSource::kSpeed:
      return "speed";
    case ScaleSource::kBoth:
      return "both";
  }
  return "invalid";
}

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

const char* toString(MeasurementStatus status) {
  switch (status) {
    case MeasurementStatus::kMeasured:
      return "none";
    case MeasurementStatus::kVoNotTracking:
      return "vo_not_tracking";
    case MeasurementStatus::kStandstill:
      return "standstill";
    case MeasurementStatus::kTooFewTriangles:
      return "too_few_triangles";
    case MeasurementStatus::kTooFewGroundPoints:
      return "too_few_ground_points";
    case MeasurementStatus::kNoPlane:
      return "no_plane";
    case MeasurementStatus::kPlaneTilted:
      return "plane_tilted";
    case MeasurementStatus::kRejectedByFilter:
      return "rejected_by_filter";
    case MeasurementStatus::kImplausibleMotion:
      return "implausible_motion";
  }
  return "invalid";
}

}  // namespace ground_scale_vo
