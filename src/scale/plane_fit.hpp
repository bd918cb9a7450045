#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "scale/road.hpp"

namespace ground_scale_vo {

/// A ground point in the camera frame c in which the plane is estimated, with the camera centre
/// that it was triangulated from: its error lies along that ray and grows with the depth squared.
struct PlanePoint {
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();       ///< VO units
  Eigen::Vector3d origin_c = Eigen::Vector3d::Zero();  ///< centre of the observing camera
  double depth = 0;        ///< along that camera's optical axis [VO units], > 0
  double depth_sigma = 0;  ///< standard deviation of depth [VO units], > 0
};

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
class PlaneFit {
 public:
  using Options = PlaneFitOptions;

  struct Result {
    /// kMeasured: all below is valid. Otherwise kTooFewGroundPoints, kNoPlane or kPlaneTilted.
    MeasurementStatus status = MeasurementStatus::kNoPlane;
    GroundPlane plane;                   ///< least squares
    double median_height = 0;            ///< median of Eq. 9 over the inliers [VO units]
    double height_sigma = 0;             ///< of either height, from residuals and camber [VO units]
    std::vector<std::uint32_t> inliers;  ///< the reserved points p* of Eq. 9, ascending indices
  };

  explicit PlaneFit(const Options& options) : options_(options) {}

  /// points: in the camera frame of prior. height_hint: approximate camera height [VO units], > 0;
  /// it only converts the distance thresholds from camera heights.
  Result fit(const std::vector<PlanePoint>& points, const RoadPrior& prior,
             double height_hint) const;

 private:
  Result fitInverseDepth(const std::vector<PlanePoint>& points, const RoadPrior& prior,
                         double height_hint) const;
  Result fitHomogeneous(const std::vector<PlanePoint>& points, double height_hint) const;

  Options options_;
};

}  // namespace ground_scale_vo
