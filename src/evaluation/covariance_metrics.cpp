#include <Eigen/Cholesky>
#include <cmath>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"

namespace gsv {
namespace {

constexpr double kSegmentLengths[] = {10, 50, 100};  // [m]
constexpr double kStartSpacing = 1;                  // between the starts of segments [m]

/// Smallest eigenvalue of a correlation matrix that is not considered singular.
constexpr double kMinEigenvalue = 0.01;

/// Scales P to a unit diagonal, so that the test does not depend on the units.
bool isWellConditioned(const Matrix6d& P) {
  if (!(P.diagonal().minCoeff() > 0)) return false;
  const Vector6d scale = P.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d correlation = scale.asDiagonal() * P * scale.asDiagonal();
  const Matrix6d excess = correlation - kMinEigenvalue * Matrix6d::Identity();
  return Eigen::LDLT<Matrix6d>(excess).vectorD().minCoeff() > 0;  // positive definite
}

/// Normalised estimation error squared.
double nees(const RelativePoseError& relative) {
  const Vector6d scale = relative.covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d correlation = scale.asDiagonal() * relative.covariance * scale.asDiagonal();
  const Vector6d normalised = scale.cwiseProduct(relative.error);
  return normalised.dot(Eigen::LDLT<Matrix6d>(correlation).solve(normalised));
}

/// Covariance of the ground truth T_i_j of a relative pose, in o axes. R_o_i: orientation of i.
Matrix6d groundTruthCovariance(const Eigen::Isometry3d& T_i_j, const Eigen::Matrix3d& R_o_i,
                               const GroundTruthAccuracy& accuracy) {
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity(), zero = Eigen::Matrix3d::Zero();
  const Eigen::Matrix3d lever = skew(T_i_j.translation());
  Eigen::Matrix<double, 6, 3> position, rotation_i, rotation_j, alignment;
  position << I, zero;
  rotation_i << lever, -I;
  rotation_j << zero, I;
  alignment << -lever, I - T_i_j.linear();
  const auto variance = [](double sigma, const Eigen::Matrix<double, 6, 3>& J) -> Matrix6d {
    return sigma * sigma * J * J.transpose();
  };
  const Matrix6d P_i = 2 * variance(accuracy.position_sigma, position) +
                       variance(accuracy.rotation_sigma, rotation_i) +
                       variance(accuracy.rotation_sigma, rotation_j) +
                       variance(accuracy.alignment_sigma, alignment);
  Matrix6d R = Matrix6d::Zero();
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = R_o_i;
  return R * P_i * R.transpose();
}

/// Covariance of a motion by the camera height, a constant factor of the whole drive.
Matrix6d heightCovariance(const RunFrame& frame, const Eigen::Vector3d& motion_o) {
  Matrix6d P = Matrix6d::Zero();
  if (frame.scale.camera_height > 0) {
    const double sigma = frame.scale.camera_height_sigma / frame.scale.camera_height;
    P.topLeftCorner<3, 3>() = sigma * sigma * motion_o * motion_o.transpose();
  }
  return P;
}

}  // namespace

RelativePoseError relativePoseError(const RunRecord& record,
                                    const std::vector<Eigen::Isometry3d>& ground_truth,
                                    std::size_t i, std::size_t j,
                                    const GroundTruthAccuracy& accuracy) {
  const RunFrame &from = record.frames().at(i), &to = record.frames().at(j);
  const Eigen::Vector3d step = to.T_o_c.translation() - from.T_o_c.translation();
  const Eigen::Isometry3d truth = ground_truth.at(i).inverse() * ground_truth.at(j);
  const Eigen::Matrix3d R_o_i = from.T_o_c.linear();
  RelativePoseError relative;
  relative.error << R_o_i * truth.translation() - step,
      rotationVector(R_o_i * truth.linear() * to.T_o_c.linear().transpose());
  Matrix6d F = Matrix6d::Identity();
  F.topRightCorner<3, 3>() = -skew(step);
  const auto ownCovariance = [](const RunFrame& frame) -> Matrix6d {
    return frame.covariance - heightCovariance(frame, frame.T_o_c.translation());
  };
  const Matrix6d moved = F * ownCovariance(from) * F.transpose();
  relative.covariance = ownCovariance(to) - moved;
  if (!isWellConditioned(relative.covariance)) relative.covariance = ownCovariance(to) + moved;
  relative.covariance += heightCovariance(to, step);
  relative.covariance += groundTruthCovariance(truth, R_o_i, accuracy);
  return relative;
}

CovarianceMetrics computeCovarianceMetrics(const RunRecord& record,
                                           const std::vector<Eigen::Isometry3d>& ground_truth,
                                           const GroundTruthAccuracy& accuracy) {
  const std::vector<RunFrame>& frames = record.frames();
  if (ground_truth.size() != frames.size()) {
    throw OptionError("the run has " + std::to_string(frames.size()) +
                      " frames, the ground truth " + std::to_string(ground_truth.size()) +
                      " poses");
  }
  const std::vector<double> distance = distancesTravelled(ground_truth);
  std::vector<std::size_t> metric;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].has_metric_pose) metric.push_back(i);
  }
  CovarianceMetrics metrics;
  if (!metric.empty()) metrics.first_metric_pose_m = distance[metric.front()];
  for (const double length : kSegmentLengths) {
    CovarianceMetrics::Length sums;
    sums.length_m = length;
    double next_start = 0;
    std::size_t end = 0;
    for (const std::size_t i : metric) {
      if (distance[i] < next_start) continue;
      next_start = distance[i] + kStartSpacing;
      while (end < metric.size() && distance[metric[end]] <= distance[i] + length) ++end;
      if (end == metric.size()) break;
      const RelativePoseError relative =
          relativePoseError(record, ground_truth, i, metric[end], accuracy);
      const Vector6d sigma = relative.covariance.diagonal().cwiseSqrt();
      ++sums.segments;
      sums.nees_per_dof += nees(relative) / 6;
      sums.within_2_sigma +=
          static_cast<double>((relative.error.array().abs() <= 2 * sigma.array()).count()) / 6;
    }
    if (sums.segments == 0) continue;
    sums.nees_per_dof /= sums.segments;
    sums.within_2_sigma /= sums.segments;
    metrics.by_length.push_back(sums);
  }
  return metrics;
}

}  // namespace gsv
