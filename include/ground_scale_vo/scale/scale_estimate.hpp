#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace gsv {

enum class ScaleStatus : std::uint8_t {
  kUnknown = 0,  ///< not known yet: there is no metric pose
  kOk = 1,       ///< a measurement of this frame was accepted
  kHeld = 2      ///< none was accepted: the last value; sigma grows with the distance travelled
};

/// Whether a stage, or a frame as a whole, has a measurement; if not, the reason.
enum class MeasurementStatus : std::uint8_t {
  kMeasured = 0,  ///< of a frame: one was used, or came before the filter may start
  kVoNotTracking = 1,
  /// Moved less than standstill_distance_heights since the last tracked frame without this status.
  kStandstill = 2,
  kTooFewTriangles = 3,
  kTooFewGroundPoints = 4,
  kNoPlane = 5,      ///< no plane fits, or its height is too uncertain
  kPlaneTilted = 6,  ///< its normal deviates too much from that predicted from mounting and motion
  kRejectedByFilter = 7,   ///< measured, but outside the filter's gate
  kImplausibleMotion = 8,  ///< the pose implies a speed above 100 m/s: it is not used
  kZoomed = 9              ///< the focal length has changed: there is no scale
};

/// What the scale of a frame was measured with, in this frame or shortly before.
enum class ScaleSource : std::uint8_t { kNone = 0, kRoad = 1, kSpeed = 2, kBoth = 3 };

/// The road as a plane in some camera's axes: n_c . x_c + height = 0, with n_c unit and pointing up
/// out of the road (its y component is negative). height > 0 is the camera's distance from the
/// plane in VO units. This is Eq. 2 with the opposite sign of the normal.
struct GroundPlane {
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
  double height = 0;
};

/// The plane that one source measured in one frame.
struct PlaneMeasurement {
  /// kMeasured: all below is valid. Otherwise the reason why there is none.
  MeasurementStatus status = MeasurementStatus::kNoPlane;
  /// Its normal in this frame's camera. Its height is that of the camera above the measured road.
  GroundPlane plane;
  double sigma = 0;          ///< standard deviation of plane.height [VO units]
  double road_distance = 0;  ///< of the measured road's centre from that camera [VO units]
  int support = 0;           ///< inlying ground points, or matched patches
  double correlation = 0;    ///< mean of the patches, weighted by texture, -1 to 1; 0: no patches
  bool is_beside_lane = false;  ///< the lane itself has too few points
};

/// The scale of one frame. Plane convention: n_c . x_c + d = 0 with n_c unit and pointing up (out
/// of the road, towards the camera), so d = h, the camera's height, positive.
/// h*: camera height [m], known or learned from speeds; h: estimated height [VO units]. Equations
/// and algorithms are those of Tian et al., ICRA 2021 (docs/explanation/how_it_works.md).
struct ScaleEstimate {
  ScaleStatus status = ScaleStatus::kUnknown;
  MeasurementStatus measurement = MeasurementStatus::kMeasured;  ///< of this frame
  /// Unfiltered h*/h measured at this frame [m per VO unit], from the aggregation window or from
  /// the alignment with earlier images, so consecutive values are correlated; 0 without one.
  double raw_scale = 0;
  double scale = 0;   ///< filtered, the one in use [m per VO unit]; 0 while kUnknown
  double sigma = 0;   ///< standard deviation of `scale` [m per VO unit]; 0 while kUnknown
  double height = 0;  ///< filtered height h of the camera [VO units]; 0 while kUnknown
  ScaleSource source = ScaleSource::kNone;  ///< kNone unless status is kOk
  double camera_height = 0;                 ///< h* [m]; 0 while it is neither given nor learned
  double camera_height_sigma = 0;           ///< its standard deviation [m]
  /// Unit, up, unfiltered. Measured; or, if there is no measurement, predicted from mounting and
  /// motion. In kStandstill, kVoNotTracking and kImplausibleMotion: as in the previous frame.
  /// Zero before the first plane of a map.
  Eigen::Vector3d n_c = Eigen::Vector3d::Zero();
  int triangles = 0;         ///< Delaunay, of features with 3-D points in the region of interest
  int ground_triangles = 0;  ///< of these, ground by normal and direction of motion (Eq. 1-3)
  int ground_points = 0;     ///< of this frame, after RANSAC (Alg. 1)
  int window_points = 0;     ///< in the aggregation window (Alg. 2)
  int plane_inliers = 0;     ///< of these, inliers of the final plane fit
};

const char* toString(ScaleSource source);        ///< "none", "road", "speed", "both"
const char* toString(ScaleStatus status);        ///< "unknown", "ok", "held"
const char* toString(MeasurementStatus status);  ///< "none", "vo_not_tracking", ...

}  // namespace gsv
