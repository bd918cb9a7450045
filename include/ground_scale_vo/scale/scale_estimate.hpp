#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace ground_scale_vo {

enum class ScaleStatus : std::uint8_t {
  kUnknown = 0,  ///< not known yet: there is no metric pose
  kOk = 1,       ///< measured in this frame
  kHeld = 2      ///< not measured in this frame: the last value; sigma grows with the distance
};

/// Why a frame has no measurement of its own.
enum class ScaleReason : std::uint8_t {
  kNone = 0,  ///< it has one
  kVoNotTracking = 1,
  kStandstill = 2,  ///< no motion since the previous frame
  kTooFewTriangles = 3,
  kTooFewGroundPoints = 4,
  kNoPlane = 5,          ///< no plane fits, or its height is too uncertain
  kPlaneTilted = 6,      ///< the plane's normal is too far from the prior
  kRejectedByFilter = 7  ///< outside the filter's gate
};

/// The scale of one frame. Plane convention: n_c . x_c + d = 0 with n_c unit and pointing up (out
/// of the road, towards the camera), so d = h, the camera's height, positive.
struct ScaleEstimate {
  ScaleStatus status = ScaleStatus::kUnknown;
  ScaleReason reason = ScaleReason::kNone;
  double raw_scale = 0;  ///< h*/h of this frame alone [m per VO unit]; 0 when there is none
  double scale = 0;      ///< filtered, the one in use [m per VO unit]; 0 while kUnknown
  double sigma = 0;      ///< standard deviation of `scale` [m per VO unit]
  double height = 0;     ///< filtered height h of the camera over the plane [VO units]
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();  ///< unit, up; zero when there is no plane yet
  int triangles = 0;                              ///< Delaunay triangles with three map points
  int ground_triangles = 0;                       ///< of these, those that passed Eq. 1-3
  int ground_points = 0;                          ///< of this frame, after RANSAC (Alg. 1)
  int window_points = 0;                          ///< in the window (Alg. 2)
  int plane_inliers = 0;                          ///< of these, reserved at convergence
};

const char* toString(ScaleStatus status);  ///< "unknown", "ok", "held"
const char* toString(ScaleReason reason);  ///< "none", "vo_not_tracking", ...

}  // namespace ground_scale_vo
