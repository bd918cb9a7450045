#include "vo/two_view.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <utility>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "vo/map.hpp"

namespace gsv {
namespace {

// RANSAC of both models. 1000 iterations are the default of cv::findEssentialMat.
constexpr double kConfidence = 0.9999;
constexpr int kMaxRansacIterations = 1000;

/// [normalised image coordinates] largest reprojection error of an inlier: 1.5 px at a focal length
/// of 718.
constexpr double kInlierThreshold = 0.0021;
/// [rad] least median angle between the rays without the rotation, to start a map: depths are then
/// known to about a tenth.
constexpr double kMinStartParallax = 0.012;
/// Least share of the matches that agree with a motion.
constexpr double kMinMotionShare = 0.45;
/// Fraction of kMinStartParallax that must remain after removing the best rotation to start a map:
/// the rotation that is fitted alone also absorbs part of a translation's flow.
constexpr double kMinParallaxFraction = 0.5;

/// Candidates with the lowest cost that are refined, and steps of the refinement.
constexpr std::size_t kRefinedCandidates = 3;
constexpr int kRefinementSteps = 10;
/// Minimum sum of the squared normal components of the two epipolar lines of a match.
constexpr double kMinEpipolarNormal = 1e-18;

/// Refits of the rotation to the matches below the median angle. Five converge.
constexpr int kRotationIterations = 5;

constexpr std::size_t kMinModelMatches = 80;
/// Support of the second best motion over that of the best; more is ambiguous.
constexpr double kMaxSecondBestRatio = 0.9;

/// [matches] minimum number for a rotation, which has three unknowns: half of them may be outliers.
constexpr std::size_t kMinRotationMatches = 40;

/// [plane distances] a shorter translation of a homography is a pure rotation.
constexpr double kMinTranslation = 1e-9;

/// [sigma] the inverse depth of a distant point may be this much below zero from noise.
constexpr double kMaxNegativeDepthSigmas = 2;

// Two candidates are the same motion when they differ by less. The essential matrix's and the
// homography's estimates of one motion do; the other solutions of their decompositions do not.
constexpr double kSameRotation = 0.02;   // [rad]
constexpr double kSameDirection = 0.15;  // [rad] of the translations

/// Minimum norm of the normal of an epipolar line [normalised image coordinates times VO units]. A
/// shorter normal has no direction: the camera has not moved, or the ray points to the epipole.
constexpr double kMinEpipolarLine = 1e-12;

using Rays = std::vector<Eigen::Vector3d>;  // z = 1

std::vector<cv::Point2d> toPoints(const Rays& rays) {
  std::vector<cv::Point2d> points;
  for (const Eigen::Vector3d& ray : rays) points.emplace_back(ray.x(), ray.y());
  return points;
}

TwoViewMotion candidate(const cv::Mat& R, const cv::Mat& t) {
  Eigen::Matrix3d R_2_1;
  Eigen::Vector3d t_2_1;
  cv::cv2eigen(R, R_2_1);
  cv::cv2eigen(t, t_2_1);
  TwoViewMotion result;
  result.T_2_1.linear() = R_2_1;
  result.T_2_1.translation() = t_2_1.normalized();
  return result;
}

std::vector<TwoViewMotion> essentialCandidates(const std::vector<cv::Point2d>& x1,
                                               const std::vector<cv::Point2d>& x2) {
  // OpenCV 4.5.2 and older have no argument for the iterations; their default is
  // kMaxRansacIterations.
  const cv::Mat E = cv::findEssentialMat(x1, x2, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC,
                                         kConfidence, kInlierThreshold);
  if (E.rows != 3 || E.cols != 3) return {};
  cv::Mat Ra, Rb, t;
  cv::decomposeEssentialMat(E, Ra, Rb, t);
  return {candidate(Ra, t), candidate(Ra, -t), candidate(Rb, t), candidate(Rb, -t)};
}

std::vector<TwoViewMotion> homographyCandidates(const std::vector<cv::Point2d>& x1,
                                                const std::vector<cv::Point2d>& x2) {
  const cv::Mat H = cv::findHomography(x1, x2, cv::RANSAC, kInlierThreshold, cv::noArray(),
                                       kMaxRansacIterations, kConfidence);
  if (H.empty()) return {};
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(H, cv::Mat::eye(3, 3, CV_64F), rotations, translations, normals);
  std::vector<TwoViewMotion> result;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    if (cv::norm(translations[i]) < kMinTranslation) continue;
    result.push_back(candidate(rotations[i], translations[i]));
    result.push_back(candidate(rotations[i], -translations[i]));
  }
  return result;
}

/// Triangulates all matches with this motion; counts inliers and cost.
void evaluate(const Rays& x1, const Rays& x2, TwoViewMotion* c) {
  c->inlier.assign(x1.size(), false);
  c->inverse_depth_1.assign(x1.size(), 0.0);
  c->inliers = 0;
  c->cost = 0;
  for (std::size_t i = 0; i < x1.size(); ++i) {
    c->cost += 1;
    const Eigen::Vector3d& ray = x1[i];
    const Eigen::Vector2d observed = x2[i].head<2>();
    const auto point = triangulate(ray, {c->T_2_1}, {{0, observed, kInlierThreshold}});
    if (!point || point->value < -kMaxNegativeDepthSigmas * point->sigma) continue;
    const Eigen::Vector3d p2 = projectOnRay(ray, point->value, c->T_2_1);
    const double error = reprojectionError(p2, observed) / kInlierThreshold;
    if (error > 1) continue;
    c->cost += error * error - 1;
    c->inlier[i] = point->value > 0;
    c->inverse_depth_1[i] = point->value;
    ++c->inliers;
  }
}

/// Refines the motion of a minimal sample with all matches: Gauss-Newton on the Sampson distance to
/// the epipolar line (Hartley & Zisserman, 11.4.3), with Geman-McClure weights.
void refine(const Rays& x1, const Rays& x2, Eigen::Isometry3d* T_2_1) {
  for (int step = 0; step < kRefinementSteps; ++step) {
    const Eigen::Matrix3d R = T_2_1->linear();
    const Eigen::Vector3d t = T_2_1->translation();
    Eigen::Matrix<double, 3, 2> tangent;  // the unit translation has two degrees of freedom
    tangent.col(0) = t.unitOrthogonal();
    tangent.col(1) = t.cross(tangent.col(0));
    const Eigen::Matrix3d E = skew(t) * R;
    Eigen::Matrix<double, 5, 5> H = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> b = Eigen::Matrix<double, 5, 1>::Zero();
    for (std::size_t i = 0; i < x1.size(); ++i) {
      const Eigen::Vector3d &a = x1[i], &c = x2[i];
      const double normal2 =
          (E * a).head<2>().squaredNorm() + (E.transpose() * c).head<2>().squaredNorm();
      if (normal2 < kMinEpipolarNormal) continue;
      const double norm = std::sqrt(normal2);
      const double residual = c.dot(E * a) / norm;
      const Eigen::Vector3d rotated = R * a;
      Eigen::Matrix<double, 5, 1> J;
      J << rotated.cross(c.cross(t)), tangent.transpose() * rotated.cross(c);
      J /= norm;
      const double m = residual / kInlierThreshold, weight = 1 / ((1 + m * m) * (1 + m * m));
      H += weight * J * J.transpose();
      b -= weight * residual * J;
    }
    const Eigen::Matrix<double, 5, 1> delta = H.ldlt().solve(b);
    if (!isFinite(delta) || delta.norm() > 1) return;
    Vector6d rotation = Vector6d::Zero();
    rotation.head<3>() = delta.head<3>();
    T_2_1->linear() = renormalised(motionFrom(rotation).linear() * R);
    T_2_1->translation() = (t + tangent * delta.tail<2>()).normalized();
  }
}

double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// The best rotation R_2_1 between the rays (Kabsch's algorithm, repeated on the better half).
/// angles: that remain between them [rad].
Eigen::Matrix3d fitRotation(const Rays& x1, const Rays& x2, std::vector<double>* angles) {
  Eigen::Matrix3d R_2_1;
  angles->assign(x1.size(), 0.0);
  for (int iteration = 0; iteration < kRotationIterations; ++iteration) {
    const double limit = median(*angles);
    Eigen::Matrix3d C = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < x1.size(); ++i) {
      if ((*angles)[i] <= limit) C += x2[i].normalized() * x1[i].normalized().transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(C, Eigen::ComputeFullU | Eigen::ComputeFullV);
    R_2_1 = svd.matrixU() * svd.matrixV().transpose();
    if (R_2_1.determinant() < 0) {
      R_2_1 = svd.matrixU() * Eigen::Vector3d(1, 1, -1).asDiagonal() * svd.matrixV().transpose();
    }
    for (std::size_t i = 0; i < x1.size(); ++i) {
      (*angles)[i] = angleBetween(R_2_1 * x1[i].normalized(), x2[i].normalized());
    }
  }
  return R_2_1;
}

bool sameMotion(const TwoViewMotion& a, const TwoViewMotion& b) {
  const double rotation =
      Eigen::AngleAxisd(a.T_2_1.linear().transpose() * b.T_2_1.linear()).angle();
  return rotation < kSameRotation &&
         a.T_2_1.translation().dot(b.T_2_1.translation()) > std::cos(kSameDirection);
}

/// Median angle between the inliers' rays after removing the rotation; 0 if there are no inliers.
double medianParallax(const Rays& x1, const Rays& x2, const TwoViewMotion& motion) {
  std::vector<double> parallax;
  for (std::size_t i = 0; i < x1.size(); ++i) {
    if (motion.inlier[i]) parallax.push_back(angleBetween(motion.T_2_1.linear() * x1[i], x2[i]));
  }
  return parallax.empty() ? 0 : median(parallax);
}

/// Motion hypotheses from the essential matrix and the homography; the first has the lowest cost.
std::vector<TwoViewMotion> rankedCandidates(const Rays& x1, const Rays& x2) {
  const std::vector<cv::Point2d> points1 = toPoints(x1), points2 = toPoints(x2);
  std::vector<TwoViewMotion> candidates = essentialCandidates(points1, points2);
  for (const TwoViewMotion& c : homographyCandidates(points1, points2)) candidates.push_back(c);
  for (TwoViewMotion& c : candidates) evaluate(x1, x2, &c);
  const auto sort = [&candidates] {
    std::stable_sort(
        candidates.begin(), candidates.end(),
        [](const TwoViewMotion& a, const TwoViewMotion& b) { return a.cost < b.cost; });
  };
  sort();
  for (std::size_t i = 0; i < std::min(kRefinedCandidates, candidates.size()); ++i) {
    TwoViewMotion refined = candidates[i];
    refine(x1, x2, &refined.T_2_1);
    evaluate(x1, x2, &refined);
    if (refined.cost < candidates[i].cost) candidates[i] = std::move(refined);
  }
  sort();
  return candidates;
}

/// The best motion that differs from candidates.front(), if it has nearly as much support (n minus
/// the cost); else null.
const TwoViewMotion* ambiguousCandidate(const std::vector<TwoViewMotion>& candidates, double n) {
  const TwoViewMotion& best = candidates.front();
  for (const TwoViewMotion& other : candidates) {
    if (sameMotion(best, other)) continue;
    return n - other.cost > kMaxSecondBestRatio * (n - best.cost) ? &other : nullptr;
  }
  return nullptr;
}

Rays raysOf(const PinholeCamera& camera, const std::vector<Eigen::Vector2d>& u) {
  Rays rays;
  for (const Eigen::Vector2d& pixel : u) rays.push_back(camera.ray(pixel));
  return rays;
}

}  // namespace

double epipolarError(const Eigen::Isometry3d& T_2_1, const Eigen::Vector3d& ray_1,
                     const Eigen::Vector3d& ray_2) {
  const Eigen::Vector3d line = T_2_1.translation().cross(T_2_1.linear() * ray_1);
  const double norm = line.head<2>().norm();
  return norm > kMinEpipolarLine ? std::abs(line.dot(ray_2)) / norm : 0;
}

std::optional<TwoViewMotion> estimateMotion(const PinholeCamera& camera,
                                            const std::vector<Eigen::Vector2d>& u1,
                                            const std::vector<Eigen::Vector2d>& u2) {
  if (u1.size() != u2.size() || u1.size() < kMinModelMatches) return std::nullopt;
  const Rays x1 = raysOf(camera, u1), x2 = raysOf(camera, u2);
  std::vector<double> angles;
  fitRotation(x1, x2, &angles);
  if (median(angles) < kMinParallaxFraction * kMinStartParallax) return std::nullopt;
  const auto candidates = rankedCandidates(x1, x2);
  if (candidates.empty()) return std::nullopt;
  const TwoViewMotion& best = candidates.front();
  const double n = static_cast<double>(x1.size());
  if (std::count(best.inlier.begin(), best.inlier.end(), true) == 0 ||
      best.inliers < kMinMotionShare * n || !isFinite(best.T_2_1) ||
      medianParallax(x1, x2, best) < kMinStartParallax || ambiguousCandidate(candidates, n)) {
    return std::nullopt;
  }
  return best;
}

RelativeRotation estimateRotation(const PinholeCamera& camera,
                                  const std::vector<Eigen::Vector2d>& u1,
                                  const std::vector<Eigen::Vector2d>& u2) {
  if (u1.size() != u2.size() || u1.size() < kMinRotationMatches) return {};
  const Rays x1 = raysOf(camera, u1), x2 = raysOf(camera, u2);
  const double n = static_cast<double>(x1.size());
  std::vector<double> angles;
  const Eigen::Matrix3d R_2_1 = fitRotation(x1, x2, &angles);
  double support = 0;  // number of matches minus the cost, as of TwoViewMotion
  for (const double angle : angles) {
    support += std::max(0.0, 1 - std::pow(angle / kInlierThreshold, 2));
  }
  std::vector<TwoViewMotion> candidates;
  if (support <= kMaxSecondBestRatio * n) {  // else no motion can have so much more
    candidates = rankedCandidates(x1, x2);
  }
  const double best_support = candidates.empty() ? 0 : n - candidates.front().cost;
  // Without parallax beyond the noise, any translation fits. With more, the rotation fitted alone
  // absorbs a part of it: up to three times what it leaves, when the camera looks to the side.
  if (candidates.empty() || support > kMaxSecondBestRatio * best_support) {
    if (support <= kMinMotionShare * n) return {};
    return {R_2_1, kInlierThreshold};
  }
  const TwoViewMotion& best = candidates.front();
  if (best.inliers < kMinMotionShare * n || !isFinite(best.T_2_1)) return {};
  RelativeRotation result{best.T_2_1.linear(), kInlierThreshold};
  if (const TwoViewMotion* other = ambiguousCandidate(candidates, n)) {
    result.sigma +=
        Eigen::AngleAxisd(best.T_2_1.linear().transpose() * other->T_2_1.linear()).angle();
  }
  return result;
}

}  // namespace gsv
