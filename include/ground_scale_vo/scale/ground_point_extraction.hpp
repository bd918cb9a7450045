#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

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
