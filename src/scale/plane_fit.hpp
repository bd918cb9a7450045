#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "scale/camera_path.hpp"
#include "scale/road.hpp"

namespace gsv {

/// Plane through ground points: pcl::SACSegmentation for the start, then weighted least squares
/// with iterated rejection of outliers (Eq. 6-8 with corrections, Alg. 2 lines 14-34).
///
/// Eq. 6 minimises the distance |n . p - h|. With weights 1/z^2, which the depth error asks for,
/// this is the difference of measured and predicted inverse depth up to a factor. But a weight that
/// depends on the measured depth favours points that came out too near, and the height shrinks by
/// the square of the relative depth error. So the residual is the inverse depth itself, whose error
/// is symmetric:
///     e_i = 1/z_i + (m . r_i) / (1 + m . o_i),   m = n / h,  p_i = o_i + z_i r_i.
/// The three unknowns m do not depend on the origin of a world frame. The weight (Eq. 8) is
/// 1 / (sigma_i^2 + (roughness / z_predicted)^2).
///
/// points: in the camera frame of prior. height_hint: approximate camera height [VO units], > 0; it
/// only converts the distance thresholds from camera heights. The plane of the result is in the
/// axes of that camera frame, its height the median of Eq. 9 over the inliers, its sigma from
/// residuals and camber; the distance of the road is not set. Status: kMeasured,
/// kTooFewGroundPoints, kNoPlane or kPlaneTilted.
PlaneMeasurement fitPlane(const std::vector<GroundPoint>& points, const RoadPrior& prior,
                          double height_hint, const PlaneFitOptions& options = {});

/// The first plane of the fit: (a, b, c, d), a x + b y + c z + d = 0, through points in camera
/// heights, by pcl::SACSegmentation with RANSAC. Its normal (a, b, c), of unit length and either
/// sign, is within max_angle [rad] of the unit vector `axis`. Empty when there is none.
/// Deterministic: one thread and PCL's constant seed. PCL prints nothing, also for degenerate
/// points, and its verbosity, which is global to the process, is not touched.
std::optional<Eigen::Vector4f> segmentPerpendicularPlane(const std::vector<Eigen::Vector3f>& points,
                                                         const Eigen::Vector3f& axis,
                                                         double max_angle);

}  // namespace gsv
