#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/road.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"

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
  enum class Method {
    kInverseDepth,  ///< as above, with the prior on the normal
    /// Eq. 6 and 7 as printed, without prior or PCL: the eigenvector of the smallest eigenvalue of
    /// Q, the sum of p p^T over the homogeneous points. The common weight of Eq. 8 has no effect.
    kHomogeneous
  };
  /// Lengths ending in _heights are in camera heights.
  struct Options {
    Method method = Method::kInverseDepth;
    int min_points = 14;
    double roughness_heights = 0.01;
    /// Roads fall off towards the gutter and pavements are higher, so the ground beside the vehicle
    /// is tilted against the ground below it. This enters the height's standard deviation alone: in
    /// the fit, points on both sides constrain each other.
    double camber_sigma_rad = 0.03;
    double reject_sigma = 2.5;               ///< of kInverseDepth
    double reject_distance_heights = 0.006;  ///< of kHomogeneous, set by paper_literal
    double max_sigma = 0.05;
    double max_tilt_rad = 0.06;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_points", self.min_points, 3, 1e6, "[points] least number for a plane");
      visit("roughness_heights", self.roughness_heights, 1e-6, 1,
            "[camera heights] standard deviation of the road surface; limits the weight of near "
            "points");
      visit("camber_sigma_rad", self.camber_sigma_rad, 1e-9, 1,
            "[rad] standard deviation of the cross slope beside the vehicle against that below it");
      visit("reject_sigma", self.reject_sigma, 0.1, 100,
            "[sigma] points with a larger residual are rejected");
      visit("max_sigma", self.max_sigma, 1e-4, 10,
            "[] largest accepted relative standard deviation of the height");
      visit("max_tilt_rad", self.max_tilt_rad, 1e-4, 1.5,
            "[rad] largest accepted angle of the normal from the prior; three standard deviations "
            "of the prior are added in quadrature");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    /// kMeasured: all below is valid. Otherwise kTooFewGroundPoints, kNoPlane or kPlaneTilted.
    MeasurementStatus status = MeasurementStatus::kNoPlane;
    GroundPlane plane;                   ///< least squares
    double median_height = 0;            ///< median of Eq. 9 over the inliers [VO units]
    double height_sigma = 0;             ///< of either height, from residuals and camber [VO units]
    std::vector<std::uint32_t> inliers;  ///< the reserved points p* of Eq. 9, ascending indices
  };

  /// Throws OptionError.
  explicit PlaneFit(const Options& options);

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
