#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"

namespace gsv {

/// The factor of the focal length between two images: a scaling of the whole image about its
/// centre, beside the motion. predicted: where points would be seen in the second image [px];
/// seen: where they are seen, for the most part. Empty: less than 3 %, or not certain. It says
/// nothing about a motion that was not predicted: towards a wall it is a scaling, too.
std::optional<double> zoomBetween(const PinholeCamera& camera,
                                  const std::vector<Eigen::Vector2d>& predicted,
                                  const std::vector<Eigen::Vector2d>& seen);

}  // namespace gsv
