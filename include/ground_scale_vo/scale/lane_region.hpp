#pragma once

#include <Eigen/Core>
#include <optional>

#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"

namespace ground_scale_vo {

/// The piece of road before the camera that the path covers: from min_ahead to max_ahead, with a
/// half width, bent as the way behind is. Lengths in camera heights on the expected plane, so it is
/// known before the height is. It lies where the camera looks, also in reverse.
class LaneRegion {
 public:
  /// height: of the camera [VO units]; 0: not known, the strip is straight.
  LaneRegion(const NormalPrior& prior, const std::optional<MotionHistory::Chord>& chord,
             double height, double min_ahead, double max_ahead, double half_width);

  /// Whether the ray (z = 1, camera axes) meets the strip.
  bool contains(const Eigen::Vector3d& ray) const;

 private:
  Eigen::Vector3d up_, ahead_, left_;
  double min_ahead_, max_ahead_, half_width_;
  double curvature_ = 0;  ///< to the left [1 / camera height]
  double lag_ = 0;        ///< the chord's direction is that of the path half of this behind
};

}  // namespace ground_scale_vo
