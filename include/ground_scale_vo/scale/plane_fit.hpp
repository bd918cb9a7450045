#pragma once

#include <Eigen/Core>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"

namespace ground_scale_vo {

/// A ground point in the axes of the frame in which the plane is sought, with the place it was seen
/// from: its error lies along that ray and grows with the square of the depth.
struct PlanePoint {
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();       ///< VO units
  Eigen::Vector3d origin_c = Eigen::Vector3d::Zero();  ///< camera centre that saw it, same axes
  double depth = 0;        ///< along that camera's optical axis, VO units, > 0
  double depth_sigma = 0;  ///< of depth, VO units, > 0
};

/// Plane through ground points: pcl::SACSegmentation for a start, then weighted least squares with
/// iterated rejection (Eq. 6-8, corrected).
///
/// Eq. 6 minimises the distance |n . p - h|. With weights ~ 1/z^2 (what the depth's error asks for)
/// that is, up to the sign, the difference of measured and predicted inverse depth; but a weight
/// taken from the measured depth favours points that came out too near, and the height shrinks by
/// the square of the relative depth error. So the residual is the inverse depth itself,
///     e_i = 1/z_i + (m . r_i) / (1 + m . o_i),   m = n / h,  p_i = o_i + z_i r_i,
/// whose error is even: unknown are the three numbers m, which do not depend on the origin of a
/// world frame, and the weight (Eq. 8) is 1 / (sigma_i^2 + (roughness / z_predicted)^2).
class PlaneFit {
 public:
  enum class Method {
    kInverseDepth,  ///< as above, with the prior of the normal
    kLiteral        ///< Eq. 6-8 as printed: homogeneous, unweighted, without prior, no PCL start
  };
  struct Options {
    Method method = Method::kInverseDepth;
    int min_points = 12;
    double sac_threshold_h = 0.04;  ///< of the PCL start: distance over the camera height
    double sac_tilt_rad = 0.087;    ///< ... normal at most this far from the prior's
    int sac_iterations = 100;
    double roughness_h = 0.01;  ///< of the road: limits the weight of near points
    /// Roads fall off to the gutter and pavements are higher: ground beside the vehicle is tilted
    /// against the ground under it. The height's sigma takes that in; the fit itself does not, as
    /// points on both sides speak against each other.
    double camber_sigma_rad = 0.03;
    /// Rejection: residuals beyond this many (robustly estimated) standard deviations.
    double reject_sigma = 2.5;
    /// Rejection of kLiteral: the paper's 0.01 m over 1.65 m.
    double reject_h = 0.006;
    int max_iterations = 15;     ///< Z of Alg. 2
    double max_sigma = 0.05;     ///< relative, of the height; more is kNoPlane
    double max_tilt_rad = 0.06;  ///< result against the prior's normal; more is kPlaneTilted
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_points", self.min_points, 3, 1e6, "[points] fewer are no plane");
      visit("sac_threshold_h", self.sac_threshold_h, 1e-6, 1,
            "[camera heights] inlier distance of SACSegmentation");
      visit("sac_tilt_rad", self.sac_tilt_rad, 1e-4, 1.5,
            "[rad] of its plane against the expected normal");
      visit("sac_iterations", self.sac_iterations, 1, 1e6, "[iterations] of SACSegmentation");
      visit("roughness_h", self.roughness_h, 1e-6, 1,
            "[camera heights] of the road: limits the weight of near points");
      visit("camber_sigma_rad", self.camber_sigma_rad, 1e-9, 1,
            "[rad] tilt of the ground beside the vehicle against that under it");
      visit("reject_sigma", self.reject_sigma, 0.1, 100, "[sigma] points beyond are rejected");
      visit("reject_h", self.reject_h, 1e-6, 1, "[camera heights] the same with paper_literal");
      visit("max_iterations", self.max_iterations, 1, 1e6, "[iterations] Z of Alg. 2");
      visit("max_sigma", self.max_sigma, 1e-4, 10, "[] relative, of the height found");
      visit("max_tilt_rad", self.max_tilt_rad, 1e-4, 1.5,
            "[rad] of the result against the expected normal");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    /// kNone: all below is valid. Otherwise kTooFewGroundPoints, kNoPlane or kPlaneTilted.
    ScaleReason status = ScaleReason::kNoPlane;
    GroundPlane plane;                   ///< least squares
    double median_height = 0;            ///< weighted median of Eq. 9 over the reserved points
    double height_sigma = 0;             ///< of either, from residuals and camber, VO units
    std::vector<std::uint32_t> inliers;  ///< reserved points p*, ascending indices
  };

  explicit PlaneFit(const Options& options);

  /// height_hint: rough camera height [VO units], > 0; only the unit of sac_threshold_h and
  /// reject_h.
  Result fit(const std::vector<PlanePoint>& points, const NormalPrior& prior,
             double height_hint) const;

 private:
  Result fitInverseDepth(const std::vector<PlanePoint>& points, const NormalPrior& prior,
                         double height_hint) const;
  Result fitLiteral(const std::vector<PlanePoint>& points, double height_hint) const;

  Options options_;
};

}  // namespace ground_scale_vo
