#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// A point of the map in the second one of two images.
struct PredictedPoint {
  Eigen::Vector2d predicted;  ///< where it would be seen [px]
  Eigen::Vector2d seen;       ///< where it is seen, for the most part [px]
  double depth = 0;           ///< in any unit
};

/// The factor of the focal length between two images: a scaling of the whole image about its
/// centre, beside the motion. Empty: less than 3 %, or not certain. Points of one depth show none:
/// a motion towards a wall is a scaling, too.
std::optional<double> zoomBetween(const PinholeCamera& camera,
                                  const std::vector<PredictedPoint>& points);

}  // namespace gsv
