#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/road.hpp"

namespace gsv {

/// What GPE has found in one frame.
struct GroundPoints {
  /// kMeasured: `points` and `plane` are valid. Otherwise kTooFewTriangles (no triangle of features
  /// with map points), kTooFewGroundPoints or kNoPlane, and `points` is empty.
  MeasurementStatus status = MeasurementStatus::kTooFewTriangles;
  std::vector<GroundPoint> points;  ///< ordered by id
  bool are_beside_lane = false;     ///< the narrow region has too few features
  GroundPlane plane;                ///< best RANSAC hypothesis, through three points
  int triangles = 0;                ///< of the triangulation
  int ground_triangles = 0;         ///< of these, accepted as ground
  double delaunay_ms = 0;           ///< wall time
};

/// Ground Point Extraction (GPE, the paper's section III.A and Alg. 1): selects the features of one
/// frame that lie on the road.
///  1. Delaunay triangles of the features in the region of interest (line 1).
///  2. Triangles whose plane lies below the camera, whose normal is orthogonal to the motion and
///     has the road's pitch and roll (lines 6-15, Eq. 1-3); their corners are candidates.
///  3. RANSAC plane through three candidates (lines 17-34, Eq. 4); its inliers are the result.
///
/// frame: tracking. prior: of the road in this frame; without a chord (no motion) the test of Eq. 3
/// is skipped. last_motion: T_{t,t-1}, used by frame_pitch_test alone.
GroundPoints extractGroundPoints(const VoFrame& frame, const RoadPrior& prior,
                                 const Eigen::Isometry3d& last_motion,
                                 const GroundPointExtractionOptions& options = {},
                                 std::uint64_t random_seed = 1);

/// Ground Point Aggregation (GPA, the paper's section III.B and Alg. 2 lines 7-13): the ground
/// points of the window that ends at the newest pose of the path, the newest frame first, in the
/// axes of the camera at T_w_c. height_hint: approximate camera height [VO units], > 0; converts
/// the window's length.
std::vector<GroundPoint> aggregateGroundPoints(const CameraPath& path,
                                               const Eigen::Isometry3d& T_w_c, double height_hint,
                                               const GroundPointAggregationOptions& options = {});

}  // namespace gsv
