#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/input/camera.hpp"
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

/// Sets Feature::to_stamp of the features in a camera at T_w_c, from the depths that
/// predictPixels() uses. readout_motion: see VoFrame; readout_angle_sigma: standard deviation of
/// its rotation [rad].
void shiftToStamp(const PinholeCamera& camera, const LocalMap& map, const Eigen::Isometry3d& T_w_c,
                  const Vector6d& readout_motion, double readout_angle_sigma,
                  std::vector<Feature>* features);

/// The same for all observations of map points by keyframes, with the depths that are known now.
void shiftToStamp(const PinholeCamera& camera, LocalMap* map);

/// The same without a map, by the flow. First corrects the flow for the time between the exposures
/// of the feature's rows in both images. dt: between their stamps [s].
void shiftToStampByFlow(const PinholeCamera& camera, double readout_time, double dt,
                        std::vector<Feature>* features);

}  // namespace ground_scale_vo
