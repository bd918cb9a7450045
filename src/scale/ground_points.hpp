#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"
#include "scale/plane_fit.hpp"
#include "scale/road.hpp"

namespace ground_scale_vo {

/// Ground Point Extraction (GPE, the paper's section III.A and Alg. 1): selects the features of one
/// frame that lie on the road.
///  1. Delaunay triangles of the features in the region of interest (line 1).
///  2. Triangles whose plane lies below the camera, whose normal is orthogonal to the motion and
///     has the road's pitch and roll (lines 6-15, Eq. 1-3); their corners are candidates.
///  3. RANSAC plane through three candidates (lines 17-34, Eq. 4); its inliers are the result.
class GroundPointExtraction {
 public:
  using Options = GroundPointExtractionOptions;

  struct Result {
    /// kMeasured: `points` and `plane` are valid. Otherwise kTooFewTriangles (no triangle of
    /// features with map points), kTooFewGroundPoints or kNoPlane, and `points` is empty.
    MeasurementStatus status = MeasurementStatus::kTooFewTriangles;
    std::vector<GroundPoint> points;  ///< ordered by id
    bool are_beside_lane = false;     ///< the narrow region has too few features
    GroundPlane plane;                ///< best RANSAC hypothesis, through three points
    int triangles = 0;                ///< of the triangulation
    int ground_triangles = 0;         ///< of these, accepted as ground
    double delaunay_ms = 0;           ///< wall time
  };

  explicit GroundPointExtraction(const Options& options, std::uint64_t random_seed = 1)
      : options_(options), random_seed_(random_seed) {}

  /// frame: tracking. prior: of the road in this frame; without a chord (no motion) the test of
  /// Eq. 3 is skipped. last_motion: T_{t,t-1}, used by frame_pitch_test alone. The result depends
  /// on the arguments alone, not on earlier calls.
  Result extract(const VoFrame& frame, const RoadPrior& prior,
                 const Eigen::Isometry3d& last_motion) const;

 private:
  std::vector<std::uint32_t> selectRegion(const VoFrame& frame, const RoadPrior& prior,
                                          bool* is_wide) const;
  bool isTilted(const GroundPlane& plane, const RoadPrior& prior, double roll_tolerance) const;
  void ransac(std::uint64_t seed, const RoadPrior& prior, Result* result) const;

  Options options_;
  std::uint64_t random_seed_;
};

/// Ground Point Aggregation (GPA, the paper's section III.B and Alg. 2): the ground points of a
/// sliding window of frames, transformed into one camera frame, and the plane through them.
class GroundPointAggregation {
 public:
  using Options = GroundPointAggregationOptions;

  struct Result {
    PlaneFit::Result fit;
    std::vector<PlanePoint> window;  ///< the points of the fit, newest frame first
  };

  explicit GroundPointAggregation(const Options& options) : options_(options), fit_(options.fit) {}

  /// Plane of the window that ends at the newest camera of the path, in the axes of one of its
  /// cameras and with the camera's prior. height_hint: approximate camera height [VO units], > 0;
  /// converts the window's length.
  Result estimate(const CameraPath& path, const CameraPath::Pose& pose, double height_hint) const;

 private:
  std::vector<PlanePoint> window(const CameraPath& path, const Eigen::Isometry3d& T_w_c,
                                 double max_length) const;

  Options options_;
  PlaneFit fit_;
};

}  // namespace ground_scale_vo
