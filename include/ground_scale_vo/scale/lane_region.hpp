#pragma once

#include <Eigen/Core>
#include <optional>

#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Lane-shaped region of the visible road: a band of constant width on the expected plane, with the
/// curvature of the driven path, ahead of the vehicle and behind it. Lengths are in camera heights,
/// so the region is defined before the height is known.
class LaneRegion {
 public:
  /// prior: normal of the expected plane, direction of motion, and offset of the region from the
  /// path. chord: gives the curvature of the driven path. height: of the camera [VO units],
  /// converts the chord's length. Without a chord, or with height 0 (not known), the region is
  /// straight. In camera heights: min_distance from the point on the road below the camera,
  /// max_ahead along the path in both directions, and half_width of the band.
  LaneRegion(const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
             double height, double min_distance, double max_ahead, double half_width);

  /// Whether a viewing ray (camera axes, z = 1) meets the plane in the region.
  bool contains(const Eigen::Vector3d& ray) const;

 private:
  Eigen::Vector3d up_, ahead_, left_;
  double offset_, min_distance_, max_ahead_, half_width_;
  double curvature_ = 0;     ///< to the left [1 / camera height]
  double chord_length_ = 0;  ///< [camera heights]; the chord runs from ahead = -chord_length_ to 0
};

/// NormalPrior::region_offset for a prior: 0 while a reasonable part of the path is in the image. A
/// camera that looks sideways does not see the path; its region is the band beside the path that is
/// nearest to it and well visible.
double visibleRegionOffset(const PinholeCamera& camera, const NormalPrior& prior);

}  // namespace ground_scale_vo
