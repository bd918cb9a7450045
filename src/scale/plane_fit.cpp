#include "ground_scale_vo/scale/plane_fit.hpp"

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/console/print.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/median.hpp"

namespace ground_scale_vo {
namespace {

/// The residuals' spread is taken as no less than this share of what their sigmas say, so that
/// exact points keep a finite weight.
constexpr double kMinSpread = 0.05;

/// Points whose scatter across their main direction is below this share of that along it lie on a
/// line, and no three of them make a plane.
constexpr double kMinScatterRatio = 1e-3;

/// Then the spread stays as it is, or the set of reserved points may never settle.
constexpr int kSpreadIterations = 5;

/// The value at which half of the weight lies below.
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

bool isCollinear(const std::vector<PlanePoint>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const PlanePoint& point : points) mean += point.p_c / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const PlanePoint& point : points) {
    scatter += (point.p_c - mean) * (point.p_c - mean).transpose();
  }
  const Eigen::Vector3d eigenvalues =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter, Eigen::EigenvaluesOnly).eigenvalues();
  return !(eigenvalues(1) > kMinScatterRatio * kMinScatterRatio * eigenvalues(2));
}

/// PCL prints a line for every degenerate triple it draws; not into our users' terminals.
class QuietPcl {
 public:
  QuietPcl() { pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS); }
  ~QuietPcl() { pcl::console::setVerbosityLevel(before_); }
  QuietPcl(const QuietPcl&) = delete;
  QuietPcl& operator=(const QuietPcl&) = delete;

 private:
  const pcl::console::VERBOSITY_LEVEL before_ = pcl::console::getVerbosityLevel();
};

/// RANSAC for the start, with PCL. Deterministic: PCL seeds its generator with a constant unless
/// told otherwise (random = false), and one thread is used. Points are handed over in camera
/// heights.
std::optional<GroundPlane> segmentPlane(const std::vector<PlanePoint>& points,
                                        const NormalPrior& prior, double height_hint,
                                        const PlaneFit::Options& options) {
  if (isCollinear(points)) return std::nullopt;
  const auto cloud = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  cloud->reserve(points.size());
  for (const PlanePoint& point : points) {
    const Eigen::Vector3f p = (point.p_c / height_hint).cast<float>();
    cloud->push_back({p.x(), p.y(), p.z()});
  }
  pcl::SACSegmentation<pcl::PointXYZ> segmentation(false);
  segmentation.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setAxis(prior.n_c.cast<float>());
  segmentation.setEpsAngle(options.sac_tilt_rad);
  segmentation.setDistanceThreshold(options.sac_threshold_h);
  segmentation.setMaxIterations(options.sac_iterations);
  segmentation.setOptimizeCoefficients(false);
  segmentation.setInputCloud(cloud);
  const QuietPcl quiet;
  pcl::PointIndices inliers;
  pcl::ModelCoefficients coefficients;
  segmentation.segment(inliers, coefficients);
  if (inliers.indices.empty() || coefficients.values.size() != 4) return std::nullopt;
  const Eigen::Vector4d plane =
      Eigen::Map<const Eigen::Vector4f>(coefficients.values.data()).cast<double>();
  const double sign = plane.head<3>().dot(prior.n_c) < 0 ? -1 : 1;
  const double height = sign * plane(3) * height_hint;
  if (!(height > 0)) return std::nullopt;
  return GroundPlane{(sign * plane.head<3>()).normalized(), height};
}

/// What a plane m = n / h predicts for a point seen from o along r: inverse depth and its
/// derivative.
struct Prediction {
  double inverse_depth = 0;
  Eigen::Vector3d jacobian;
};
/// Empty when the plane lies behind that ray, or above that camera.
std::optional<Prediction> predict(const PlanePoint& point, const Eigen::Vector3d& m) {
  const Eigen::Vector3d r = (point.p_c - point.origin_c) / point.depth;
  const double height_ratio = 1 + m.dot(point.origin_c);  // that camera's height over this one's
  const double inverse_depth = -m.dot(r) / height_ratio;
  if (!(height_ratio > 0) || !(inverse_depth > 0)) return std::nullopt;
  return Prediction{inverse_depth, -(r + inverse_depth * point.origin_c) / height_ratio};
}

}  // namespace

void PlaneFit::Options::validate() const { visitParameters(*this, RangeCheck("fit/")); }

PlaneFit::PlaneFit(const Options& options) : options_(options) { options_.validate(); }

PlaneFit::Result PlaneFit::fit(const std::vector<PlanePoint>& points, const NormalPrior& prior,
                               double height_hint) const {
  if (points.size() < static_cast<std::size_t>(options_.min_points)) {
    Result result;
    result.status = ScaleReason::kTooFewGroundPoints;
    return result;
  }
  return options_.method == Method::kLiteral ? fitLiteral(points, height_hint)
                                             : fitInverseDepth(points, prior, height_hint);
}

PlaneFit::Result PlaneFit::fitInverseDepth(const std::vector<PlanePoint>& points,
                                           const NormalPrior& prior, double height_hint) const {
  Result result;
  const std::optional<GroundPlane> start = segmentPlane(points, prior, height_hint, options_);
  if (!start) return result;

  const Eigen::Vector3d forward = prior.forward_c, lateral = prior.lateral();
  Eigen::Vector3d m = start->n_c / start->height;
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  std::vector<double> residual(points.size()), sigma(points.size());  // inverse depth
  std::vector<std::uint32_t> kept, last_kept;
  double spread = 1;  // of the residuals, in units of their own sigma
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    // Rejection (Alg. 2 lines 19-24), around the present plane.
    std::vector<double> deviations;
    deviations.reserve(points.size());
    kept.clear();
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      const std::optional<Prediction> prediction = predict(points[i], m);
      residual[i] = std::numeric_limits<double>::infinity();
      if (!prediction) continue;
      // Eq. 8, for each point: what its own depth and the road's roughness let expect.
      sigma[i] = std::hypot(points[i].depth_sigma / (points[i].depth * points[i].depth),
                            options_.roughness_h * prediction->inverse_depth);
      residual[i] = 1 / points[i].depth - prediction->inverse_depth;
      deviations.push_back(std::abs(residual[i]) / sigma[i]);
    }
    if (deviations.size() < static_cast<std::size_t>(options_.min_points)) return result;
    if (iteration < kSpreadIterations) {
      spread = std::max(kMinSpread, kSigmaOfMad * median(std::move(deviations)));
    }
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      if (std::abs(residual[i]) <= options_.reject_sigma * spread * sigma[i]) kept.push_back(i);
    }
    if (kept.size() < static_cast<std::size_t>(options_.min_points)) return result;

    // Eq. 7: normal equations of the reserved points and of the prior; two steps, as it is nearly
    // linear.
    H.setZero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (const std::uint32_t i : kept) {
      const std::optional<Prediction> prediction = predict(points[i], m);
      const double weight = 1 / (spread * spread * sigma[i] * sigma[i]);
      H += weight * prediction->jacobian * prediction->jacobian.transpose();
      b += weight * prediction->jacobian * residual[i];
    }
    const double h = 1 / m.norm();
    for (const auto& [axis, axis_sigma] :
         {std::pair(forward, prior.pitch_sigma), std::pair(lateral, prior.roll_sigma)}) {
      const Eigen::Vector3d jacobian = h * axis / axis_sigma;
      H += jacobian * jacobian.transpose();
      b -= jacobian * jacobian.dot(m);
    }
    const Eigen::Vector3d step = H.ldlt().solve(b);
    if (!isFinite(step)) return result;
    m += step;
    if (!(m.dot(prior.n_c) > 0)) return result;
    if (kept == last_kept && step.norm() < 1e-9 * m.norm()) break;
    last_kept = kept;
  }

  result.plane.height = 1 / m.norm();
  result.plane.n_c = m * result.plane.height;
  const double tilt = std::acos(std::clamp(result.plane.n_c.dot(prior.n_c), -1.0, 1.0));
  if (tilt > options_.max_tilt_rad) {
    result.status = ScaleReason::kPlaneTilted;
    return result;
  }

  // Eq. 9 (Alg. 2 lines 31-34): the height from each reserved point alone, h_j = -n . p_j. The
  // median weighs by its relative error, with the predicted depth: the measured one would favour
  // near ones.
  std::vector<std::pair<double, double>> heights;
  heights.reserve(kept.size());
  for (const std::uint32_t i : kept) {
    heights.emplace_back(-result.plane.n_c.dot(points[i].p_c),
                         (1 / points[i].depth - residual[i]) / sigma[i]);
  }
  result.median_height = weightedMedian(std::move(heights));
  const Eigen::Matrix3d covariance = H.inverse();
  const double sigma_of_fit =
      result.plane.height * result.plane.height *
      std::sqrt(std::max(0.0, result.plane.n_c.dot(covariance * result.plane.n_c)));
  // Where the points lie beside the camera on average, each by its weight in the height.
  double weights = 0, beside = 0;
  for (const std::uint32_t i : kept) {
    const double weight = std::pow(sigma[i] * points[i].depth, -2);
    weights += weight;
    beside += weight * lateral.dot(points[i].p_c);
  }
  result.height_sigma = std::hypot(sigma_of_fit, options_.camber_sigma_rad * beside / weights);
  const bool known = result.height_sigma <= options_.max_sigma * result.plane.height;
  if (!known || !areFinite(result.plane.n_c, result.plane.height, result.median_height)) {
    result.status = ScaleReason::kNoPlane;
    return result;
  }
  result.inliers = std::move(kept);
  result.status = ScaleReason::kNone;
  return result;
}

PlaneFit::Result PlaneFit::fitLiteral(const std::vector<PlanePoint>& points,
                                      double height_hint) const {
  Result result;
  std::vector<std::uint32_t> kept(points.size());
  std::iota(kept.begin(), kept.end(), 0u);
  GroundPlane plane;
  double squares = 0;
  for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
    // Eq. 7; the scalar weight of Eq. 8 changes nothing.
    Eigen::Matrix4d Q = Eigen::Matrix4d::Zero();
    for (const std::uint32_t i : kept) {
      const Eigen::Vector4d p = points[i].p_c.homogeneous();
      Q += p * p.transpose();
    }
    const Eigen::Vector4d mu =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(Q).eigenvectors().col(0);
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
      if (distance > options_.reject_h * height_hint) continue;
      next.push_back(i);
      squares += distance * distance;
    }
    if (next.size() < static_cast<std::size_t>(options_.min_points)) return result;
    const bool converged = next.size() == kept.size();
    kept = std::move(next);
    if (converged) break;
  }
  if (!(plane.height > 0)) return result;
  std::vector<double> heights;  // Eq. 9
  heights.reserve(kept.size());
  for (const std::uint32_t i : kept) heights.push_back(-plane.n_c.dot(points[i].p_c));
  result.plane = plane;
  result.median_height = median(std::move(heights));
  result.height_sigma = std::sqrt(squares / static_cast<double>(kept.size()));
  if (!areFinite(plane.n_c, plane.height, result.height_sigma)) return result;
  result.inliers = std::move(kept);
  result.status = ScaleReason::kNone;
  return result;
}

}  // namespace ground_scale_vo
