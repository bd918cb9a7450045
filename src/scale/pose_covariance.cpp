#include "ground_scale_vo/scale/pose_covariance.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

/// Median of the squared norm of a two-dimensional normal error over the variance per axis.
constexpr double kMedianSquaredNorm = 1.3863;  // 2 ln 2
/// Of an inlier: 99 % quantile of the chi-squared distribution with two degrees of freedom.
constexpr double kMaxSquaredMahalanobis = 9.2;
/// Relative damping: bounds the covariance when the points do not determine the pose.
constexpr double kRelativeDamping = 1 + 1e-6;

/// Of the normalised image coordinates of a point p with respect to (position, rotation) of the
/// camera, in camera axes.
Eigen::Matrix<double, 2, 6> projectionJacobian(const Eigen::Vector3d& p) {
  const double iz = 1 / p.z(), x = p.x() * iz, y = p.y() * iz;
  Eigen::Matrix<double, 2, 3> J_p;
  J_p << iz, 0, -x * iz, 0, iz, -y * iz;
  Eigen::Matrix<double, 2, 6> J;
  J << -J_p, J_p * skew(p);
  return J;
}

}  // namespace

Matrix6d poseCovariance(const VoFrame& frame, double scale) {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> squared_errors;
  for (const TrackedFeature& feature : frame.features) {
    if (!hasUsablePoint(feature)) continue;
    const Eigen::Vector3d p = feature.p_c.cast<double>();
    const Eigen::Vector3d observed = frame.camera.ray(feature.u.cast<double>());
    const double squared_error = (p.hnormalized() - observed.head<2>()).squaredNorm();
    if (!std::isfinite(squared_error)) continue;
    points.push_back(p);
    squared_errors.push_back(squared_error);
  }
  if (points.size() < static_cast<std::size_t>(kMinPosePoints)) return Matrix6d::Zero();
  const double variance = median(squared_errors) / kMedianSquaredNorm;
  Matrix6d H = Matrix6d::Zero();
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (squared_errors[i] > kMaxSquaredMahalanobis * variance) continue;
    const Eigen::Matrix<double, 2, 6> J = projectionJacobian(scale * points[i]);
    H.noalias() += J.transpose() * J;
  }
  H.diagonal() *= kRelativeDamping;
  const Matrix6d covariance = variance * H.ldlt().solve(Matrix6d::Identity());
  return isFinite(covariance) ? covariance : Matrix6d::Zero();
}

}  // namespace ground_scale_vo
