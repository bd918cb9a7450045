#pragma once

#include <Eigen/Core>
#include <optional>

#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"

namespace ground_scale_vo {

/// Lane-shaped region of the visible road: a band of constant width on the expected plane, with the
/// curvature of the driven path. It lies in the viewing direction: the road about to be driven
/// over, or in reverse the road just driven over. Lengths are in camera heights, so the region is
/// defined before the height is known.
class LaneRegion {
 public:
  /// prior: normal of the expected plane and direction of motion. chord: gives the curvature of the
  /// driven path. height: of the camera [VO units], converts the chord's length. Without a chord,
  /// or with height 0 (not known), the region is straight. min_ahead, max_ahead, half_width:
  /// [camera heights].
  LaneRegion(const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
             double height, double min_ahead, double max_ahead, double half_width);

  /// Whether a viewing ray (camera axes, z = 1) meets the plane in the region.
  bool contains(const Eigen::Vector3d& ray) const;

 private:
  Eigen::Vector3d up_, ahead_, left_;
  double min_ahead_, max_ahead_, half_width_;
  double curvature_ = 0;  ///< to the left [1 / camera height]
  /// Chord length [camera heights], negative in reverse: the chord runs from ahead = -chord_length_
  /// to 0.
  double chord_length_ = 0;
};

}  // namespace ground_scale_vo
