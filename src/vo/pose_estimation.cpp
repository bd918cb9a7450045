#include "ground_scale_vo/vo/pose_estimation.hpp"

#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/se3.hpp"

namespace ground_scale_vo {
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
/// [rad] a larger rotation step means divergence.
constexpr double kMaxRotation = 1;
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

// RANSAC with P3P, when the prediction fails or is doubtful. With 50 % outliers, 72 draws of 4
// points contain an all-inlier sample with 99 % probability; 200 suffice at 40 % inliers, the
// default of min_inlier_share.
constexpr int kRansacIterations = 200;
constexpr double kRansacConfidence = 0.99;
/// [normalised coordinates] largest reprojection error of an inlier: 4 px at a focal length of 718.
constexpr double kRansacThreshold = 0.006;

struct LinearisedObservation {
  bool in_front = false;
  Eigen::Vector2d residual;
  /// Transposed Jacobian with respect to a left perturbation of T_c_w (SO(3) x R^3):
  /// motionFrom(delta) * T_c_w.
  Eigen::Matrix<double, 6, 2> Jt;
  Eigen::Matrix2d information;
};

LinearisedObservation linearise(const Eigen::Isometry3d& T_c_w, const PointObservation& o) {
  LinearisedObservation l;
  const Eigen::Vector3d p = T_c_w * o.p_w;
  if (p.z() < kMinObservedDepth) return l;
  l.in_front = true;
  const double iz = 1 / p.z();
  l.residual = p.head<2>() * iz - o.x;
  // Derivative of the residual by p: [iz I, d]; by the motion: [iz I, d] [-skew(p), I].
  const Eigen::Vector2d d = -p.head<2>() * iz * iz;
  l.Jt.col(0) << d.x() * p.y(), iz * p.z() - d.x() * p.x(), -iz * p.y(), iz, 0, d.x();
  l.Jt.col(1) << d.y() * p.y() - iz * p.z(), -d.y() * p.x(), iz * p.x(), 0, iz, d.y();
  const Eigen::Vector3d sigma_c = T_c_w.linear() * o.sigma_w;
  const Eigen::Vector2d g = iz * sigma_c.head<2>() + d * sigma_c.z();
  // (sigma^2 I + g g^T)^-1
  const double n2 = o.sigma * o.sigma;
  l.information = (Eigen::Matrix2d::Identity() - g * g.transpose() / (n2 + g.squaredNorm())) / n2;
  return l;
}

}  // namespace

std::vector<PointObservation> pointObservations(const LocalMap& map,
                                                const std::vector<LocalMap::Corner>& corners,
                                                std::vector<std::size_t>* index) {
  std::vector<PointObservation> observations;
  observations.reserve(corners.size());
  LandmarkWalk landmarks(map.landmarks());
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const auto point = map.pointOf(landmarks.find(corners[i].id));
    if (!point) continue;
    observations.push_back({point->p_w, point->sigma_w, corners[i].x, corners[i].sigma});
    if (index) index->push_back(i);
  }
  return observations;
}

void PoseEstimation::Options::validate() const { visitParameters(*this, RangeCheck("pose/")); }

PoseEstimation::PoseEstimation(const Options& options) : options_(options) { options_.validate(); }

PoseEstimation::Result PoseEstimation::refine(
    const Eigen::Isometry3d& start_T_w_c, const std::vector<PointObservation>& observations) const {
  Result result;
  Eigen::Isometry3d T_c_w = start_T_w_c.inverse();
  for (int iteration = 0; iteration < kMaxPoseIterations; ++iteration) {
    const double scale = std::max(1.0, kInitialScale / (iteration + 1));
    Matrix6d H = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
    for (const PointObservation& o : observations) {
      const LinearisedObservation l = linearise(T_c_w, o);
      if (!l.in_front) continue;
      const double m2 = l.residual.dot(l.information * l.residual) / (scale * scale);
      const double weight = 1 / ((1 + m2 / kGemanMcClure) * (1 + m2 / kGemanMcClure));
      const Eigen::Matrix<double, 6, 2> JtW = weight * l.Jt * l.information;
      H.noalias() += JtW * l.Jt.transpose();
      b.noalias() -= JtW * l.residual;
    }
    result.information = H;
    H.diagonal() *= kDiagonalFactor;
    const Vector6d step = H.ldlt().solve(b);
    if (!isFinite(step)) break;
    if (step.head<3>().norm() > kMaxRotation) break;
    T_c_w = motionFrom(step) * T_c_w;
    if (scale == 1.0 && b.dot(step) < kConverged) break;
  }

  result.T_w_c = T_c_w.inverse();
  result.T_w_c.linear() = renormalised(result.T_w_c.linear());
  result.inlier.reserve(observations.size());
  const double limit2 = options_.inlier_sigma * options_.inlier_sigma;
  for (const PointObservation& o : observations) {
    const LinearisedObservation l = linearise(T_c_w, o);
    const bool inlier = l.in_front && l.residual.dot(l.information * l.residual) < limit2;
    result.inlier.push_back(inlier);
    result.inliers += inlier;
  }
  const double share = options_.min_inlier_share * static_cast<double>(observations.size());
  // An implausible position counts as kTooFewInliers, too.
  result.status = result.inliers >= options_.min_inliers && result.inliers >= share &&
                          isPlausiblePosition(result.T_w_c.translation())
                      ? PoseStatus::kOk
                      : PoseStatus::kTooFewInliers;
  return result;
}

PoseEstimation::Result PoseEstimation::estimate(
    const Eigen::Isometry3d& predicted_T_w_c,
    const std::vector<PointObservation>& observations) const {
  if (static_cast<int>(observations.size()) < options_.min_inliers) return {};
  Result result = refine(predicted_T_w_c, observations);
  const double doubtful = kDoubtfulInlierShare * static_cast<double>(observations.size());
  if (result.status == PoseStatus::kOk && result.inliers >= doubtful) return result;

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
  cv::cv2eigen(R, R_c_w);
  Eigen::Isometry3d T_c_w = Eigen::Isometry3d::Identity();
  T_c_w.linear() = R_c_w;
  T_c_w.translation() = Eigen::Vector3d(translation.at<double>(0), translation.at<double>(1),
                                        translation.at<double>(2));
  Result from_ransac = refine(T_c_w.inverse(), observations);
  const double min_ratio = result.status == PoseStatus::kOk ? kMinInlierRatio : 1;
  return from_ransac.inliers > min_ratio * result.inliers ? from_ransac : result;
}

}  // namespace ground_scale_vo
