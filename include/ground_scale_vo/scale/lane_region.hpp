#pragma once

#include <Eigen/Core>
#include <optional>

#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"

namespace ground_scale_vo {

/// Region of the road ahead that the vehicle is expected to drive over: a band of constant width on
/// the expected plane, with the curvature of the path driven so far. Lengths are in camera heights,
/// so the region is defined before the height is known. It lies in the viewing direction, also in
/// reverse.
class LaneRegion {
 public:
  /// prior: the expected plane's normal. chord: averaged motion; without it the region is straight,
  /// likewise when height [VO units] is 0 (not known). min_ahead, max_ahead, half_width: [camera
  /// heights].
  LaneRegion(const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
             double height, double min_ahead, double max_ahead, double half_width);

  /// Whether a viewing ray (camera axes, z = 1) meets the plane in the region.
  bool contains(const Eigen::Vector3d& ray) const;

 private:
  Eigen::Vector3d up_, ahead_, left_;
  double min_ahead_, max_ahead_, half_width_;
  double curvature_ = 0;  ///< to the left [1 / camera height]
  /// Signed chord length [camera heights]: the chord is parallel to the path at its middle.
  double chord_length_ = 0;
};

}  // namespace ground_scale_vo
