#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/camera_path.hpp"
#include "ground_scale_vo/scale/plane_fit.hpp"
#include "ground_scale_vo/scale/road.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Ground Point Extraction (GPE, the paper's section III.A and Alg. 1): selects the features of one
/// frame that lie on the road.
///  1. Delaunay triangles of the features in the region of interest (line 1).
///  2. Triangles whose plane lies below the camera, whose normal is orthogonal to the motion and
///     has the road's pitch and roll (lines 6-15, Eq. 1-3); their corners are candidates.
///  3. RANSAC plane through three candidates (lines 17-34, Eq. 4); its inliers are the result.
class GroundPointExtraction {
 public:
  /// Lengths ending in _heights are in camera heights.
  struct Options {
    // Region of interest on the expected plane. It depends on the pixel's ray alone and never on
    // the depth of a point, so it does not bias the depth.
    double min_ahead_heights = 1.0;
    double max_ahead_heights = 25.0;
    double lane_half_width_heights = 1.2;
    double max_half_width_heights = 4.0;
    int min_lane_features = 15;

    double motion_tolerance_rad = 0.12;
    double pitch_tolerance_rad = 0.12;
    int min_points = 6;
    double plane_threshold_heights = 0.006;  ///< the paper's 0.01 m over 1.65 m
    double plane_threshold_sigma = 2.0;
    bool frame_pitch_test = false;  ///< theta_1 on the pitch of T_{t,t-1}, as printed (line 10)
    bool most_inliers = false;

    std::uint64_t random_seed = 1;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_ahead_heights", self.min_ahead_heights, 0, 1000,
            "[camera heights] near end of the region of interest");
      visit("max_ahead_heights", self.max_ahead_heights, 0, 10000,
            "[camera heights] far end of the region of interest");
      visit("lane_half_width_heights", self.lane_half_width_heights, 0.01, 1000,
            "[camera heights] half width of the region while it contains min_lane_features");
      visit("max_half_width_heights", self.max_half_width_heights, 0.01, 1000,
            "[camera heights] half width of the region otherwise");
      visit("min_lane_features", self.min_lane_features, 0, 1e6,
            "[features] number that is enough for the narrow region");
      visit("motion_tolerance_rad", self.motion_tolerance_rad, 1e-4, 1.6,
            "[rad] theta_2 of Alg. 1: largest |90 deg - angle(n, t)| of a triangle");
      visit(
          "pitch_tolerance_rad", self.pitch_tolerance_rad, 1e-4, 1.6,
          "[rad] theta_1 of Alg. 1: largest pitch of a triangle, and pitch and roll of the plane, "
          "against the road; three standard deviations of the prior are added in quadrature");
      visit("min_points", self.min_points, 3, 1e6,
            "[points] least number of ground points (Alg. 1 line 18)");
      visit("plane_threshold_heights", self.plane_threshold_heights, 1e-6, 1,
            "[camera heights] d_thresh of Alg. 1: inlier distance from the plane");
      visit("plane_threshold_sigma", self.plane_threshold_sigma, 0, 100,
            "[sigma] multiple of the relative depth error of a point that is added to "
            "plane_threshold_heights in quadrature");
      visit("most_inliers", self.most_inliers,
            "[] RANSAC by the number of inliers (Alg. 1), not by the distance (Eq. 4)");
    }
    /// Throws OptionError.
    void validate() const;
  };

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

  /// Throws OptionError.
  explicit GroundPointExtraction(const Options& options);

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
};

/// Ground Point Aggregation (GPA, the paper's section III.B and Alg. 2): the ground points of a
/// sliding window of frames, transformed into one camera frame, and the plane through them.
class GroundPointAggregation {
 public:
  struct Options {
    double window_heights = 3.0;
    int max_frames = 60;
    /// A map point has one error however often it is seen; its copies are not independent.
    bool unique_features = true;
    PlaneFit::Options fit;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("window_heights", self.window_heights, 0, 1e6,
            "[camera heights] length of the window, as distance travelled");
      visit("max_frames", self.max_frames, 1, 1e6,
            "[frames] in the window at most (Alg. 2 line 8)");
      visit("unique_features", self.unique_features,
            "[] a feature seen in several frames counts once, with its newest point");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    PlaneFit::Result fit;
    std::vector<PlanePoint> window;  ///< the points of the fit, newest frame first
  };

  /// Throws OptionError.
  explicit GroundPointAggregation(const Options& options);

  /// Plane of the window that ends at the newest camera of the path, in the axes of one of its
  /// cameras and with the camera's prior. height_hint: approximate camera height [VO units], > 0;
  /// converts the window's length.
  Result estimate(const CameraPath& path, const CameraPath::Camera& camera,
                  double height_hint) const;

 private:
  std::vector<PlanePoint> window(const CameraPath& path, const Eigen::Isometry3d& T_w_c,
                                 double max_length) const;

  Options options_;
  PlaneFit fit_;
};

}  // namespace ground_scale_vo
