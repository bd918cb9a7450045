#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace ground_scale_vo {

/// Plane (a, b, c, d), a x + b y + c z + d = 0, through points in camera heights, by
/// pcl::SACSegmentation with RANSAC. Its normal (a, b, c), of unit length and either sign, is
/// within max_angle [rad] of the unit vector `axis`. Empty when there is none.
///
/// Deterministic: one thread and PCL's constant seed. PCL prints nothing, also for degenerate
/// points, and its verbosity, which is global to the process, is not touched.
std::optional<Eigen::Vector4f> segmentPerpendicularPlane(const std::vector<Eigen::Vector3f>& points,
                                                         const Eigen::Vector3f& axis,
                                                         double max_angle);

}  // namespace ground_scale_vo
