#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "vo/recovery.hpp"

namespace ground_scale_vo {

/// Finds the pose of an image in the map after an interruption in which the camera has moved and
/// turned too far for descriptors of corners: rates the poses of a grid by the correlations of all
/// patches at their projections, and refines the best one.
/// features: of the last tracked image `previous`. Both images: 8-bit grey. The exposures may
/// differ. mask: as for VisualOdometry. Takes some tenths of a second. Empty when no pose stands
/// out, when too few patches agree with it, or when the distance deviates too much from that at the
/// last velocity.
std::optional<RelocalisedPose> locateBySearch(const PinholeCamera& camera, const cv::Mat& mask,
                                              const LocalMap& map, const MotionModel& motion,
                                              const std::vector<Feature>& features,
                                              const cv::Mat& previous, const cv::Mat& image,
                                              std::int64_t stamp_ns);

}  // namespace ground_scale_vo
