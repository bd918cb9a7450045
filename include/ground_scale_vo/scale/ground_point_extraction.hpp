#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// A feature of one frame that lies on the road.
struct GroundPoint {
  std::uint64_t id = 0;                           ///< of the feature
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();  ///< camera axes of its frame, VO units, z > 0
  double depth_sigma = 0;                         ///< of p_c.z, VO units
};

/// Ground Point Extraction (GPE, the paper's section III.A and Alg. 1): which of a frame's features
/// lie on the road.
class GroundPointExtraction {
 public:
  struct Options {
    /// The region of the road that is looked at, in camera heights on the expected plane. It is cut
    /// by the pixel's ray alone, never by a point's own depth, so it cannot bias the depth.
    double min_ahead_h = 1.0;
    double max_ahead_h = 25.0;
    double lane_h = 1.2;         ///< half width of the region while it holds lane_points features
    double max_lateral_h = 4.0;  ///< half width otherwise
    int lane_points = 15;

    double motion_tolerance_rad = 0.12;  ///< theta_2 of Alg. 1: |90 deg - angle(n, t)| (Eq. 3)
    double pitch_tolerance_rad = 0.12;   ///< theta_1: pitch of the triangle against the road's
    double roll_tolerance_rad = 0.26;    ///< roll likewise: Eq. 3 lets walls along the way pass
    int min_points = 6;                  ///< Alg. 1 line 18: more than five
    int ransac_iterations = 100;         ///< Z of Alg. 1
    /// d_thresh of Alg. 1: distance to the plane over the camera height; the paper's 0.01 m / 1.65
    /// m.
    double plane_threshold_h = 0.006;
    /// ... plus this many standard deviations of the point's own depth. 0: as printed.
    double plane_threshold_sigma = 2.0;

    // The paper's literal choices.
    bool frame_pitch_test =
        false;                  ///< theta_1 on the relative rotation's pitch, not the triangle's
    bool most_inliers = false;  ///< Alg. 1 line 28; otherwise the least truncated distance (Eq. 4)

    std::uint64_t random_seed = 1;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_ahead_h", self.min_ahead_h, 0, 1000,
            "[camera heights] where the region of the road begins");
      visit("max_ahead_h", self.max_ahead_h, 0, 10000, "[camera heights] where it ends");
      visit("lane_h", self.lane_h, 0.01, 1000,
            "[camera heights] half width of the region while it holds lane_points");
      visit("max_lateral_h", self.max_lateral_h, 0.01, 1000,
            "[camera heights] half width otherwise");
      visit("lane_points", self.lane_points, 0, 1e6,
            "[features] that are enough for the narrow region");
      visit("motion_tolerance_rad", self.motion_tolerance_rad, 1e-4, 1.6,
            "[rad] theta_2 of Alg. 1: |90 deg - angle(n, t)|");
      visit("pitch_tolerance_rad", self.pitch_tolerance_rad, 1e-4, 1.6,
            "[rad] theta_1 of Alg. 1: pitch of a triangle against the road");
      visit("roll_tolerance_rad", self.roll_tolerance_rad, 1e-4, 1.6,
            "[rad] roll of a triangle against the road");
      visit("min_points", self.min_points, 3, 1e6, "[points] fewer are no ground");
      visit("ransac_iterations", self.ransac_iterations, 1, 1e6, "[iterations] Z of Alg. 1");
      visit("plane_threshold_h", self.plane_threshold_h, 1e-6, 1,
            "[camera heights] d_thresh of Alg. 1");
      visit("plane_threshold_sigma", self.plane_threshold_sigma, 0, 100,
            "[sigma] of a point's own depth, added to it");
      visit("most_inliers", self.most_inliers,
            "[] RANSAC by most inliers (Alg. 1), not by least distance (Eq. 4)");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    /// kNone: `points` and `plane` are valid. Otherwise kTooFewTriangles (not one triangle of
    /// features with points), kTooFewGroundPoints or kNoPlane, and both are empty.
    ScaleReason status = ScaleReason::kTooFewTriangles;
    std::vector<GroundPoint> points;  ///< by id
    GroundPlane plane;                ///< best hypothesis, through three points
    int triangles = 0;
    int ground_triangles = 0;
    double delaunay_ms = 0;  ///< wall time
  };

  explicit GroundPointExtraction(const Options& options);

  /// frame: tracking. prior: the road's normal in this frame's camera. chord: averaged direction of
  /// motion; without one (no motion) its test is left out. last_motion: T_{t,t-1}, used by
  /// frame_pitch_test alone. The result depends on the arguments only, not on earlier calls.
  Result extract(const VoFrame& frame, const NormalPrior& prior,
                 const std::optional<MotionHistory::Chord>& chord,
                 const Eigen::Isometry3d& last_motion) const;

 private:
  std::vector<std::uint32_t> candidates(const VoFrame& frame, const NormalPrior& prior) const;
  void ransac(std::uint64_t seed, const NormalPrior& prior, Result* result) const;

  Options options_;
};

}  // namespace ground_scale_vo
