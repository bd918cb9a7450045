#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/vo/camera.hpp"
#include "ground_scale_vo/vo/local_map.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {

/// Predicts the pixel of each feature of a camera at T_w_previous in a camera at T_w_next [px]: the
/// projection of its map point or, without a map point, of a point at the median inverse depth of
/// the map points around it.
std::vector<cv::Point2f> predictPixels(const PinholeCamera& camera, const LocalMap& map,
                                       const std::vector<Feature>& features,
                                       const Eigen::Isometry3d& T_w_previous,
                                       const Eigen::Isometry3d& T_w_next);

/// Prediction without a map: each feature continues with its flow. dt: [s].
std::vector<cv::Point2f> predictPixelsByFlow(const std::vector<Feature>& features, double dt);

}  // namespace ground_scale_vo
