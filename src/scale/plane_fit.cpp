#include "scale/plane_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

constexpr std::size_t kMinPoints = 14;  ///< of a plane: with fewer, a kerb passes for the road
/// [camera heights] Standard deviation of the road surface; limits the weight of near points.
constexpr double kRoughness = 0.01;
/// [standard deviations] Points with a larger residual are rejected.
constexpr double kRejectSigma = 2.5;
constexpr double kMaxSigma = 0.05;  ///< largest accepted one of the height, relative
/// [rad] Largest accepted angle of the normal from the prior; three standard deviations of the
/// prior are added in quadrature.
constexpr double kMaxTilt = 0.06;
/// Lower bound of the residuals' robust scale relative to their expected standard deviations, so
/// that exact points keep finite weights.
constexpr double kMinRobustScale = 0.05;

/// [rad] Tolerance of the normal of the first plane; the prior's uncertainty is added.
constexpr double kSacTilt = 0.087;

/// From then on the robust scale is fixed, otherwise the set of inliers may oscillate.
constexpr int kRobustScaleIterations = 5;

/// Relative step of m at which the fit has converged, far below any error of the measurements.
constexpr double kConvergedStep = 1e-9;
constexpr int kMaxFitIterations = 15;  ///< Z of Alg. 2

/// Points whose standard deviation across their main direction is below this share of that along
/// it lie on a line and define no plane.
constexpr double kMinAspectRatio = 1e-3;

/// Precondition: not empty.
double weightedMedian(std::vector<std::pair<double, double>> value_and_weight) {
  std::sort(value_and_weight.begin(), value_and_weight.end());
  const double half =
      0.5 * std::accumulate(value_and_weight.begin(), value_and_weight.end(), 0.0,
                            [](double sum, const auto& v) { return sum + v.second; });
  double sum = 0;
  for (const auto& [value, weight] : value_and_weight) {
    sum += weight;
    if (sum >= half) return value;
  }
  return value_and_weight.back().first;
}

bool isCollinear(const std::vector<GroundPoint>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const GroundPoint& point : points) mean += point.p_c / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const GroundPoint& point : points) {
    scatter += (point.p_c - mean) * (point.p_c - mean).transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(scatter, Eigen::EigenvaluesOnly);  // ascending
  const Eigen::Vector3d& eigenvalues = solver.eigenvalues();
  return !(eigenvalues(1) > kMinAspectRatio * kMinAspectRatio * eigenvalues(2));
}

/// Start of the least-squares fit.
std::optional<GroundPlane> segmentPlane(const std::vector<GroundPoint>& points,
                                        const RoadPrior& prior, double height_hint) {
  if (isCollinear(points)) return std::nullopt;
  std::vector<Eigen::Vector3f> scaled;
  scaled.reserve(points.size());
  for (const GroundPoint& point : points) scaled.push_back((point.p_c / height_hint).cast<float>());
  const double max_angle = std::max(prior.pitchTolerance(kSacTilt), prior.rollTolerance(kSacTilt));
  const auto plane = segmentPerpendicularPlane(scaled, prior.n_c.cast<float>(), max_angle);
  if (!plane) return std::nullopt;
  const Eigen::Vector3d normal = plane->head<3>().cast<double>();
  const double sign = normal.dot(prior.n_c) < 0 ? -1 : 1;
  const double height = sign * static_cast<double>((*plane)(3)) * height_hint;
  if (!(height > 0)) return std::nullopt;
  return GroundPlane{(sign * normal).normalized(), height};
}

/// Measured minus predicted inverse depth of one point [1 / VO unit].
struct Residual {
  /// Infinite: the plane does not intersect the point's ray ahead of the camera, or lies above that
  /// camera.
  double value = std::numeric_limits<double>::infinity();
  double sigma = 1;                                    ///< expected standard deviation (Eq. 8)
  Eigen::Vector3d jacobian = Eigen::Vector3d::Zero();  ///< of the prediction by m
};

/// Of all points, for the plane m = n / h.
std::vector<Residual> computeResiduals(const std::vector<GroundPoint>& points,
                                       const Eigen::Vector3d& m, double roughness_heights) {
  std::vector<Residual> residuals(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const GroundPoint& point = points[i];
    const Eigen::Vector3d r = (point.p_c - point.origin_c) / point.depth;
    const double height_ratio = 1 + m.dot(point.origin_c);  // observing camera's height over h
    const double inverse_depth = -m.dot(r) / height_ratio;
    if (!(height_ratio > 0) || !(inverse_depth > 0)) continue;
    residuals[i].value = 1 / point.depth - inverse_depth;
    // Eq. 8 for each point: the errors of its depth and of the road surface.
    residuals[i].sigma = std::hypot(point.depth_sigma / (point.depth * point.depth),
                                    roughness_heights * inverse_depth);
    residuals[i].jacobian = -(r + inverse_depth * point.origin_c) / height_ratio;
  }
  return residuals;
}

/// Robust standard deviation of the residuals in units of their sigma.
double robustScale(const std::vector<Residual>& residuals) {
  std::vector<double> normalised;
  for (const Residual& residual : residuals) {
    if (!std::isinf(residual.value))
      normalised.push_back(std::abs(residual.value) / residual.sigma);
  }
  return normalised.empty() ? kMinRobustScale
                            : std::max(kMinRobustScale, kMadToSigma * median(&normalised));
}

/// Indices of the residuals within `limit` sigma (Alg. 2 lines 19-24).
std::vector<std::uint32_t> selectInliers(const std::vector<Residual>& residuals, double limit) {
  std::vector<std::uint32_t> inliers;
  for (std::uint32_t i = 0; i < residuals.size(); ++i) {
    if (std::abs(residuals[i].value) <= limit * residuals[i].sigma) inliers.push_back(i);
  }
  return inliers;
}

/// Eq. 7 for a correction of m: of the inliers, and of the prior on the normal's pitch and roll.
NormalEquations<3> normalEquations(const std::vector<Residual>& residuals,
                                   const std::vector<std::uint32_t>& inliers, double robust_scale,
                                   const RoadPrior& prior, const Eigen::Vector3d& m) {
  NormalEquations<3> equations;
  for (const std::uint32_t i : inliers) {
    const Residual& residual = residuals[i];
    const double weight = 1 / (robust_scale * robust_scale * residual.sigma * residual.sigma);
    equations.H += weight * residual.jacobian * residual.jacobian.transpose();
    equations.b += weight * residual.jacobian * residual.value;
  }
  prior.addTo(m, 1 / m.norm(), equations.H, equations.b);
  return equations;
}

/// Eq. 9 (Alg. 2 lines 31-34): median over the heights from single inliers, h_j = -n . p_j. Each is
/// weighted by the inverse of its relative error at the predicted depth; the measured depth would
/// favour near points.
double medianHeight(const std::vector<GroundPoint>& points, const std::vector<Residual>& residuals,
                    const std::vector<std::uint32_t>& inliers, const Eigen::Vector3d& n_c) {
  std::vector<std::pair<double, double>> heights;
  heights.reserve(inliers.size());
  for (const std::uint32_t i : inliers) {
    heights.emplace_back(-n_c.dot(points[i].p_c),
                         (1 / points[i].depth - residuals[i].value) / residuals[i].sigma);
  }
  return weightedMedian(std::move(heights));
}

/// Mean lateral position of the inliers, weighted by their information on the height [VO units].
double meanLateral(const std::vector<GroundPoint>& points, const std::vector<Residual>& residuals,
                   const std::vector<std::uint32_t>& inliers, const Eigen::Vector3d& lateral) {
  double weights = 0, sum = 0;
  for (const std::uint32_t i : inliers) {
    const double weight = std::pow(residuals[i].sigma * points[i].depth, -2);
    weights += weight;
    sum += weight * lateral.dot(points[i].p_c);
  }
  return sum / weights;
}

PlaneMeasurement fitInverseDepth(const std::vector<GroundPoint>& points, const RoadPrior& prior,
                                 double height_hint, double camber_sigma) {
  PlaneMeasurement result;
  const std::optional<GroundPlane> start = segmentPlane(points, prior, height_hint);
  if (!start) return result;

  Eigen::Vector3d m = start->n_c / start->height;
  NormalEquations<3> equations;
  std::vector<Residual> residuals;
  std::vector<std::uint32_t> inliers, last_inliers;
  double robust_scale = 1;
  for (int iteration = 0; iteration < kMaxFitIterations; ++iteration) {
    residuals = computeResiduals(points, m, kRoughness);
    if (iteration < kRobustScaleIterations) robust_scale = robustScale(residuals);
    inliers = selectInliers(residuals, kRejectSigma * robust_scale);
    if (inliers.size() < kMinPoints) return result;

    equations = normalEquations(residuals, inliers, robust_scale, prior, m);
    const Eigen::Vector3d step = equations.H.ldlt().solve(equations.b);
    if (!isFinite(step)) return result;
    m += step;
    if (!(m.dot(prior.n_c) > 0)) return result;
    if (inliers == last_inliers && step.norm() < kConvergedStep * m.norm()) break;
    last_inliers = inliers;
  }

  const double height = 1 / m.norm();
  const GroundPlane plane{m * height, height};  // least squares
  const double tilt = std::hypot(plane.n_c.dot(prior.forward_c) / prior.pitchTolerance(kMaxTilt),
                                 plane.n_c.dot(prior.lateral()) / prior.rollTolerance(kMaxTilt));
  if (tilt > 1) {
    result.status = MeasurementStatus::kPlaneTilted;
    return result;
  }
  const double median_height = medianHeight(points, residuals, inliers, plane.n_c);
  const Eigen::Matrix3d covariance = equations.H.inverse();
  const double fit_sigma =
      plane.height * plane.height * std::sqrt(std::max(0.0, plane.n_c.dot(covariance * plane.n_c)));
  // Error of the height from the cross slope of the ground beside the vehicle. For the decision
  // whether the points suffice, it counts from the middle of the region that they were taken from.
  const double left = meanLateral(points, residuals, inliers, prior.lateral());
  const double left_in_region = left - prior.region_offset * plane.height;
  result.sigma = std::hypot(fit_sigma, camber_sigma * left);
  const bool is_certain =
      std::hypot(fit_sigma, camber_sigma * left_in_region) <= kMaxSigma * plane.height;
  if (!is_certain || !areFinite(plane.n_c, plane.height, median_height)) return result;
  result.plane = {plane.n_c, median_height};
  result.support = static_cast<int>(inliers.size());
  result.status = MeasurementStatus::kMeasured;
  return result;
}

/// max_distance: of an inlier [VO units].
PlaneMeasurement fitHomogeneous(const std::vector<GroundPoint>& points, double max_distance) {
  PlaneMeasurement result;
  std::vector<std::uint32_t> kept(points.size());
  std::iota(kept.begin(), kept.end(), 0u);
  GroundPlane plane;
  double squares = 0;
  for (int iteration = 0; iteration < kMaxFitIterations; ++iteration) {
    // Eq. 7: the eigenvector of the smallest eigenvalue. The scalar weight of Eq. 8 has no effect.
    Eigen::Matrix4d Q = Eigen::Matrix4d::Zero();
    for (const std::uint32_t i : kept) {
      const Eigen::Vector4d p = points[i].p_c.homogeneous();
      Q += p * p.transpose();
    }
    // Q is symmetric, so its singular vectors are its eigenvectors, the smallest last.
    const Eigen::Vector4d mu =
        Eigen::JacobiSVD<Eigen::Matrix4d>(Q, Eigen::ComputeFullV).matrixV().col(3);
    const double norm = mu.head<3>().norm();
    if (!(norm > 0)) return result;
    const double sign = mu.y() < 0 ? 1 : -1;
    plane.n_c = sign * mu.head<3>() / norm;
    plane.height = sign * mu.w() / norm;
    // Lines 19-24, with the absolute value that D > d lacks.
    std::vector<std::uint32_t> next;
    squares = 0;
    for (const std::uint32_t i : kept) {
      const double distance = std::abs(plane.n_c.dot(points[i].p_c) + plane.height);
      if (distance > max_distance) continue;
      next.push_back(i);
      squares += distance * distance;
    }
    if (next.size() < kMinPoints) return result;
    const bool converged = next.size() == kept.size();
    kept = std::move(next);
    if (converged) break;
  }
  if (!(plane.height > 0)) return result;
  std::vector<double> heights;  // Eq. 9
  heights.reserve(kept.size());
  for (const std::uint32_t i : kept) heights.push_back(-plane.n_c.dot(points[i].p_c));
  result.sigma = std::sqrt(squares / static_cast<double>(kept.size()));
  if (!areFinite(plane.n_c, plane.height, result.sigma)) return result;
  result.plane = {plane.n_c, median(std::move(heights))};
  result.support = static_cast<int>(kept.size());
  result.status = MeasurementStatus::kMeasured;
  return result;
}

}  // namespace

PlaneMeasurement fitPlane(const std::vector<GroundPoint>& points, const RoadPrior& prior,
                          double height_hint, const PlaneFitOptions& options) {
  if (points.size() < kMinPoints) {
    PlaneMeasurement result;
    result.status = MeasurementStatus::kTooFewGroundPoints;
    return result;
  }
  return options.homogeneous
             ? fitHomogeneous(points, options.reject_distance_heights * height_hint)
             : fitInverseDepth(points, prior, height_hint, options.camber_sigma_rad);
}

}  // namespace gsv
