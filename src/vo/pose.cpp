#include "vo/pose.hpp"

#include <algorithm>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "common/simd.hpp"
#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "vo/projection_jacobian.hpp"

namespace gsv {
namespace {

/// [VO units] minimum depth (z) of a point in front of the camera.
constexpr double kMinObservedDepth = 1e-6;

// Gauss-Newton with Geman-McClure weights 1 / (1 + m^2 / c)^2 of the Mahalanobis distance m.

/// c: the weight is one half at 1.3 sigma.
constexpr double kGemanMcClure = 4;
/// Scale of the kernel in iteration i = 1, 2 ...: max(1, kInitialScale / i) (graduated
/// non-convexity).
constexpr double kInitialScale = 4.0;
/// Relative damping: keeps H positive definite when a direction is barely constrained.
constexpr double kDiagonalFactor = 1 + 1e-9;
constexpr int kMaxPoseIterations = 15;
/// The same for the covariance, which it bounds when the points do not determine the pose.
constexpr double kCovarianceDiagonalFactor = 1 + 1e-6;
/// Median of the squared Mahalanobis distance of a two-dimensional normal error.
constexpr double kMedianDistance2 = 1.3863;  // 2 ln 2
/// Gauss-Newton decrement b.delta below which the iteration stops.
constexpr double kConverged = 1e-6;

/// With a smaller share of inliers, the prediction may be wrong and the result a local minimum that
/// fits distant points only: two images whose stamps are closer together than their exposures give
/// a prediction without motion. None of 1466 frames of nine drives at 10 Hz, also in dense traffic
/// and in low light, had a smaller share.
constexpr double kDoubtfulInlierShare = 0.6;
/// Minimum ratio of the inliers of RANSAC to those from the prediction. A ratio near 1 may as well
/// be due to vehicles that move along.
constexpr double kMinInlierRatio = 1.2;

constexpr double kInlierSigma = 3.5;  ///< largest Mahalanobis distance of an inlier

// RANSAC with P3P, when the prediction fails or is doubtful. With 50 % outliers, 72 draws of 4
// points contain an all-inlier sample with 99 % probability; 200 suffice at 40 % inliers, the
// default of min_inlier_share.
constexpr int kRansacIterations = 200;
constexpr double kRansacConfidence = 0.99;
/// [normalised coordinates] largest reprojection error of an inlier: 4 px at a focal length of 718.
constexpr double kRansacThreshold = 0.006;

/// Observations in arrays. The last one also fills the last vector; the copies have an infinite
/// variance.
struct ObservationArrays {
  std::size_t size;
  std::vector<double> numbers;  // nine arrays of this size

  explicit ObservationArrays(const std::vector<PointObservation>& observations)
      : size(padded(observations.size(), kSimdDoubles)), numbers(9 * size) {
    for (std::size_t i = 0; i < size; ++i) {
      const bool copy = i >= observations.size();
      const PointObservation& o = copy ? observations.back() : observations[i];
      const double variance = copy ? std::numeric_limits<double>::infinity() : o.sigma * o.sigma;
      const double values[] = {o.p_w.x(),     o.p_w.y(), o.p_w.z(), o.sigma_w.x(), o.sigma_w.y(),
                               o.sigma_w.z(), o.x.x(),   o.x.y(),   variance};
      for (std::size_t k = 0; k < 9; ++k) numbers[k * size + i] = values[k];
    }
  }
  const Doubles& p_w(std::size_t axis, std::size_t i) const { return at(axis, i); }
  const Doubles& sigma_w(std::size_t axis, std::size_t i) const { return at(3 + axis, i); }
  const Doubles& x(std::size_t axis, std::size_t i) const { return at(6 + axis, i); }
  const Doubles& variance(std::size_t i) const { return at(8, i); }

 private:
  const Doubles& at(std::size_t k, std::size_t i) const { return simd(&numbers[k * size + i]); }
};

/// Adds the normal equations over a left perturbation of T_c_w (SO(3) x R^3), motionFrom(delta) *
/// T_c_w, weighted by the kernel of this scale, or with a scale of 0 those of the inliers alone.
/// distances2: set to the squared Mahalanobis distances, infinite behind the camera; padded to
/// whole vectors.
GSV_VECTOR_LOOP void sumObservations(const Eigen::Isometry3d& T_c_w, const ObservationArrays& o,
                                     double scale, double* distances2, ProjectionSums* sums) {
  const Eigen::Matrix4d& T = T_c_w.matrix();
  const double infinity = std::numeric_limits<double>::infinity();
  const Doubles infinite = {infinity, infinity, infinity, infinity};
  const Doubles zero = {}, one = {1, 1, 1, 1};
  for (std::size_t i = 0; i < o.size; i += kSimdDoubles) {
    Doubles p[3], sigma_c[3];
    for (int k = 0; k < 3; ++k) {
      sigma_c[k] =
          T(k, 0) * o.sigma_w(0, i) + T(k, 1) * o.sigma_w(1, i) + T(k, 2) * o.sigma_w(2, i);
      p[k] = T(k, 0) * o.p_w(0, i) + T(k, 1) * o.p_w(1, i) + T(k, 2) * o.p_w(2, i) + T(k, 3);
    }
    const auto behind = p[2] < kMinObservedDepth;
    const Doubles inverse_z = 1 / (behind ? one : p[2]);
    const ProjectionJacobian J{p[0] * inverse_z, p[1] * inverse_z, inverse_z};
    const Doubles r_x = J.ux - o.x(0, i), r_y = J.uy - o.x(1, i);  // residual
    const Doubles g_x = inverse_z * (sigma_c[0] - J.ux * sigma_c[2]);
    const Doubles g_y = inverse_z * (sigma_c[1] - J.uy * sigma_c[2]);
    // Its information matrix, (sigma^2 I + g g^T)^-1.
    const Doubles& n2 = o.variance(i);
    const Doubles inverse_n2 = 1 / n2, h = inverse_n2 / (n2 + g_x * g_x + g_y * g_y);
    const Doubles xx = inverse_n2 - h * g_x * g_x, yy = inverse_n2 - h * g_y * g_y;
    const Doubles xy = -h * g_x * g_y;
    const Doubles squares = r_x * (xx * r_x + xy * r_y) + r_y * (xy * r_x + yy * r_y);
    const Doubles distance2 = behind ? infinite : squares;
    simd(distances2 + i) = distance2;
    Doubles weight = distance2 < kInlierSigma * kInlierSigma ? one : zero;
    if (scale > 0) {
      const Doubles root = 1 / (1 + distance2 / (scale * scale * kGemanMcClure));
      weight = root * root;
    }
    sums->add(J, weight * xx, weight * xy, weight * yy, r_x, r_y);
  }
}

/// See PoseEstimate. H: over (rotation, position).
Matrix6d covarianceOf(Matrix6d H, std::vector<double> distances2) {
  H.diagonal() *= kCovarianceDiagonalFactor;
  const double variance = median(&distances2) / kMedianDistance2;
  const Matrix6d C = variance * H.ldlt().solve(Matrix6d::Identity());
  Matrix6d covariance;
  covariance << C.bottomRightCorner<3, 3>(), C.bottomLeftCorner<3, 3>(), C.topRightCorner<3, 3>(),
      C.topLeftCorner<3, 3>();
  return isFinite(covariance) ? covariance : Matrix6d::Zero();
}

PoseEstimate minimiseReprojections(const Eigen::Isometry3d& start_T_w_c,
                                   const std::vector<PointObservation>& observations,
                                   int min_inliers, double min_inlier_share) {
  PoseEstimate result;
  const ObservationArrays arrays(observations);
  std::vector<double> distances2(arrays.size);
  Eigen::Isometry3d T_c_w = start_T_w_c.inverse();
  for (int iteration = 0; iteration < kMaxPoseIterations; ++iteration) {
    const double scale = std::max(1.0, kInitialScale / (iteration + 1));
    ProjectionSums sums;
    sumObservations(T_c_w, arrays, scale, distances2.data(), &sums);
    Matrix6d H = sums.hessian();
    const Vector6d b = -sums.gradientSum();
    H.diagonal() *= kDiagonalFactor;
    const Vector6d step = H.ldlt().solve(b);
    if (!isFinite(step)) break;
    T_c_w = motionFrom(step) * T_c_w;
    if (scale == 1.0 && b.dot(step) < kConverged) break;
  }

  result.T_w_c = T_c_w.inverse();
  result.T_w_c.linear() = renormalised(result.T_w_c.linear());
  ProjectionSums sums;
  sumObservations(T_c_w, arrays, 0, distances2.data(), &sums);
  distances2.resize(observations.size());
  result.covariance = covarianceOf(sums.hessian(), distances2);
  result.inlier.reserve(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const bool inlier = distances2[i] < kInlierSigma * kInlierSigma;
    result.inlier.push_back(inlier);
    result.inliers += inlier;
  }
  const double share = min_inlier_share * static_cast<double>(observations.size());
  result.ok = result.inliers >= min_inliers && result.inliers >= share &&
              isPlausiblePosition(result.T_w_c.translation());
  return result;
}

}  // namespace

std::vector<PointObservation> pointObservations(const LocalMap& map,
                                                const std::vector<Observation>& observations,
                                                std::vector<std::size_t>* index) {
  std::vector<PointObservation> with_point;
  with_point.reserve(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const auto point = map.point(observations[i].id);
    if (!point) continue;
    with_point.push_back({*point, observations[i].x, observations[i].sigma});
    if (index) index->push_back(i);
  }
  return with_point;
}

PoseEstimate estimatePose(const Eigen::Isometry3d& predicted_T_w_c,
                          const std::vector<PointObservation>& observations, int min_inliers,
                          double min_inlier_share) {
  if (static_cast<int>(observations.size()) < min_inliers) return {};
  const auto estimateFrom = [&](const Eigen::Isometry3d& start_T_w_c) {
    return minimiseReprojections(start_T_w_c, observations, min_inliers, min_inlier_share);
  };
  PoseEstimate result = estimateFrom(predicted_T_w_c);
  const double doubtful = kDoubtfulInlierShare * static_cast<double>(observations.size());
  if (result.ok && result.inliers >= doubtful) return result;

  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> image_points;
  for (const PointObservation& o : observations) {
    points.emplace_back(o.p_w.x(), o.p_w.y(), o.p_w.z());
    image_points.emplace_back(o.x.x(), o.x.y());
  }
  cv::Mat rotation_vector, translation, R;
  if (!cv::solvePnPRansac(points, image_points, cv::Mat::eye(3, 3, CV_64F), cv::noArray(),
                          rotation_vector, translation, false, kRansacIterations,
                          static_cast<float>(kRansacThreshold), kRansacConfidence, cv::noArray(),
                          cv::SOLVEPNP_AP3P)) {
    return result;
  }
  cv::Rodrigues(rotation_vector, R);
  Eigen::Matrix3d R_c_w;
  Eigen::Vector3d t_c_w;
  cv::cv2eigen(R, R_c_w);
  cv::cv2eigen(translation, t_c_w);
  Eigen::Isometry3d T_c_w = Eigen::Isometry3d::Identity();
  T_c_w.linear() = R_c_w;
  T_c_w.translation() = t_c_w;
  PoseEstimate from_ransac = estimateFrom(T_c_w.inverse());
  const double min_ratio = result.ok ? kMinInlierRatio : 1;
  return from_ransac.inliers > min_ratio * result.inliers ? from_ransac : result;
}

}  // namespace gsv
