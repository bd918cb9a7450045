#include "vo/two_view.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "vo/map.hpp"

namespace ground_scale_vo {
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

struct Candidate {
  Eigen::Isometry3d T_2_1 = Eigen::Isometry3d::Identity();
  std::vector<bool> inlier;  // fits, with a positive inverse depth
  std::vector<double> inverse_depth_1;
  int inliers = 0;  // matches that fit, also those whose inverse depth is not positive from noise
  double cost = 0;  // sum of squared errors, truncated at 1, in units of the inlier threshold
};

Eigen::Matrix3d toEigen(const cv::Mat& m) {
  Eigen::Matrix3d result;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) result(r, c) = m.at<double>(r, c);
  return result;
}

Candidate candidate(const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
  Candidate result;
  result.T_2_1.linear() = R;
  result.T_2_1.translation() = t.normalized();
  return result;
}

std::vector<Candidate> essentialCandidates(const std::vector<cv::Point2d>& x1,
                                           const std::vector<cv::Point2d>& x2, double threshold) {
  // OpenCV 4.5.2 and older have no argument for the iterations; their default is
  // kMaxRansacIterations.
  const cv::Mat E =
      cv::findEssentialMat(x1, x2, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, kConfidence, threshold);
  if (E.rows != 3 || E.cols != 3) return {};
  cv::Mat Ra, Rb, t;
  cv::decomposeEssentialMat(E, Ra, Rb, t);
  const Eigen::Vector3d t_eigen(t.at<double>(0), t.at<double>(1), t.at<double>(2));
  return {candidate(toEigen(Ra), t_eigen), candidate(toEigen(Ra), -t_eigen),
          candidate(toEigen(Rb), t_eigen), candidate(toEigen(Rb), -t_eigen)};
}

std::vector<Candidate> homographyCandidates(const std::vector<cv::Point2d>& x1,
                                            const std::vector<cv::Point2d>& x2, double threshold) {
  const cv::Mat H = cv::findHomography(x1, x2, cv::RANSAC, threshold, cv::noArray(),
                                       kMaxRansacIterations, kConfidence);
  if (H.empty()) return {};
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(H, cv::Mat::eye(3, 3, CV_64F), rotations, translations, normals);
  std::vector<Candidate> result;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    const cv::Mat& t = translations[i];
    const Eigen::Vector3d t_eigen(t.at<double>(0), t.at<double>(1), t.at<double>(2));
    if (t_eigen.norm() < kMinTranslation) continue;
    result.push_back(candidate(toEigen(rotations[i]), t_eigen));
    result.push_back(candidate(toEigen(rotations[i]), -t_eigen));
  }
  return result;
}

/// Triangulates all matches with this motion; counts inliers and cost.
void evaluate(const std::vector<cv::Point2d>& x1, const std::vector<cv::Point2d>& x2,
              double threshold, Candidate* c) {
  c->inlier.assign(x1.size(), false);
  c->inverse_depth_1.assign(x1.size(), 0.0);
  c->inliers = 0;
  c->cost = 0;
  for (std::size_t i = 0; i < x1.size(); ++i) {
    c->cost += 1;
    const Eigen::Vector3d ray(x1[i].x, x1[i].y, 1);
    const Eigen::Vector2d observed(x2[i].x, x2[i].y);
    const auto point = triangulate(ray, {{c->T_2_1, observed, threshold}});
    if (!point || point->value < -kMaxNegativeDepthSigmas * point->sigma) continue;
    const Eigen::Vector3d p2 = projectOnRay(ray, point->value, c->T_2_1).p;
    const double error = reprojectionError(p2, observed) / threshold;
    if (error > 1) continue;
    c->cost += error * error - 1;
    c->inlier[i] = point->value > 0;
    c->inverse_depth_1[i] = point->value;
    ++c->inliers;
  }
}

/// Refines the motion of a minimal sample with all matches: Gauss-Newton on the Sampson distance to
/// the epipolar line (Hartley & Zisserman, 11.4.3), with Geman-McClure weights.
void refine(const std::vector<cv::Point2d>& x1, const std::vector<cv::Point2d>& x2,
            double threshold, Eigen::Isometry3d* T_2_1) {
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
      const Eigen::Vector3d a(x1[i].x, x1[i].y, 1), c(x2[i].x, x2[i].y, 1);
      const double normal2 =
          (E * a).head<2>().squaredNorm() + (E.transpose() * c).head<2>().squaredNorm();
      if (normal2 < kMinEpipolarNormal) continue;
      const double norm = std::sqrt(normal2);
      const double residual = c.dot(E * a) / norm;
      const Eigen::Vector3d rotated = R * a;
      Eigen::Matrix<double, 5, 1> J;
      J << rotated.cross(c.cross(t)), tangent.transpose() * rotated.cross(c);
      J /= norm;
      const double m = residual / threshold, weight = 1 / ((1 + m * m) * (1 + m * m));
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

struct RotationFit {
  Eigen::Matrix3d R_2_1 = Eigen::Matrix3d::Identity();
  std::vector<double> angles;  ///< that remain between the rays [rad]
  double median_angle = 0;     ///< [rad]

  /// Number of matches minus the cost, as in Candidate.
  double support(double threshold) const {
    double sum = 0;
    for (const double angle : angles) sum += std::max(0.0, 1 - std::pow(angle / threshold, 2));
    return sum;
  }
};

/// The best rotation between the rays (Kabsch's algorithm, repeated on the better half).
RotationFit fitRotation(const std::vector<cv::Point2d>& x1, const std::vector<cv::Point2d>& x2) {
  std::vector<Eigen::Vector3d> rays1, rays2;
  for (std::size_t i = 0; i < x1.size(); ++i) {
    rays1.push_back(Eigen::Vector3d(x1[i].x, x1[i].y, 1).normalized());
    rays2.push_back(Eigen::Vector3d(x2[i].x, x2[i].y, 1).normalized());
  }
  RotationFit fit;
  std::vector<double>& angles = fit.angles;
  angles.assign(x1.size(), 0.0);
  fit.median_angle = 1;
  for (int iteration = 0; iteration < kRotationIterations; ++iteration) {
    Eigen::Matrix3d C = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < rays1.size(); ++i) {
      if (angles[i] <= fit.median_angle) C += rays2[i] * rays1[i].transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(C, Eigen::ComputeFullU | Eigen::ComputeFullV);
    fit.R_2_1 = svd.matrixU() * svd.matrixV().transpose();
    if (fit.R_2_1.determinant() < 0) {
      fit.R_2_1 =
          svd.matrixU() * Eigen::Vector3d(1, 1, -1).asDiagonal() * svd.matrixV().transpose();
    }
    for (std::size_t i = 0; i < rays1.size(); ++i) {
      const Eigen::Vector3d rotated = fit.R_2_1 * rays1[i];
      angles[i] = std::atan2(rotated.cross(rays2[i]).norm(), rotated.dot(rays2[i]));
    }
    fit.median_angle = median(angles);
  }
  return fit;
}

bool sameMotion(const Candidate& a, const Candidate& b) {
  const double rotation =
      Eigen::AngleAxisd(a.T_2_1.linear().transpose() * b.T_2_1.linear()).angle();
  return rotation < kSameRotation &&
         a.T_2_1.translation().dot(b.T_2_1.translation()) > std::cos(kSameDirection);
}

/// Median angle between the inliers' rays after removing the rotation; 0 if there are no inliers.
double medianParallax(const std::vector<cv::Point2d>& x1, const std::vector<cv::Point2d>& x2,
                      const Candidate& c) {
  std::vector<double> parallax;
  for (std::size_t i = 0; i < x1.size(); ++i) {
    if (!c.inlier[i]) continue;
    const Eigen::Vector3d rotated = c.T_2_1.linear() * Eigen::Vector3d(x1[i].x, x1[i].y, 1);
    const Eigen::Vector3d ray(x2[i].x, x2[i].y, 1);
    parallax.push_back(std::atan2(rotated.cross(ray).norm(), rotated.dot(ray)));
  }
  return parallax.empty() ? 0 : median(parallax);
}

/// Motion hypotheses from the essential matrix and the homography; the first has the lowest cost.
std::vector<Candidate> rankedCandidates(const std::vector<cv::Point2d>& x1,
                                        const std::vector<cv::Point2d>& x2, double threshold) {
  std::vector<Candidate> candidates = essentialCandidates(x1, x2, threshold);
  for (const Candidate& c : homographyCandidates(x1, x2, threshold)) candidates.push_back(c);
  for (Candidate& c : candidates) evaluate(x1, x2, threshold, &c);
  const auto sort = [&candidates] {
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  };
  sort();
  for (std::size_t i = 0; i < std::min(kRefinedCandidates, candidates.size()); ++i) {
    Candidate refined = candidates[i];
    refine(x1, x2, threshold, &refined.T_2_1);
    evaluate(x1, x2, threshold, &refined);
    if (refined.cost < candidates[i].cost) candidates[i] = std::move(refined);
  }
  sort();
  return candidates;
}

/// The best motion that differs from candidates.front(), if it has nearly as much support (n minus
/// the cost); else null.
const Candidate* ambiguousCandidate(const std::vector<Candidate>& candidates, double n,
                                    double max_ratio) {
  const Candidate& best = candidates.front();
  for (const Candidate& other : candidates) {
    if (sameMotion(best, other)) continue;
    return n - other.cost > max_ratio * (n - best.cost) ? &other : nullptr;
  }
  return nullptr;
}

std::vector<cv::Point2d> normalisedCoordinates(const PinholeCamera& camera,
                                               const std::vector<Eigen::Vector2d>& u) {
  std::vector<cv::Point2d> x;
  for (const Eigen::Vector2d& pixel : u) {
    const Eigen::Vector3d ray = camera.ray(pixel);
    x.emplace_back(ray.x(), ray.y());
  }
  return x;
}

}  // namespace

double epipolarError(const Eigen::Isometry3d& T_2_1, const Eigen::Vector3d& ray_1,
                     const Eigen::Vector3d& ray_2) {
  const Eigen::Vector3d line = T_2_1.translation().cross(T_2_1.linear() * ray_1);
  const double norm = line.head<2>().norm();
  return norm > kMinEpipolarLine ? std::abs(line.dot(ray_2)) / norm : 0;
}

TwoView::Result TwoView::estimate(const PinholeCamera& camera,
                                  const std::vector<Eigen::Vector2d>& u1,
                                  const std::vector<Eigen::Vector2d>& u2) const {
  Result result;
  if (u1.size() != u2.size() || u1.size() < kMinModelMatches) {
    result.status = TwoViewStatus::kTooFewMatches;
    return result;
  }
  const auto x1 = normalisedCoordinates(camera, u1), x2 = normalisedCoordinates(camera, u2);
  if (fitRotation(x1, x2).median_angle < kMinParallaxFraction * kMinStartParallax) {
    result.status = TwoViewStatus::kTooLittleParallax;
    return result;
  }

  const auto candidates = rankedCandidates(x1, x2, kInlierThreshold);
  if (candidates.empty()) return result;
  const Candidate& best = candidates.front();
  const double n = static_cast<double>(x1.size());
  if (std::count(best.inlier.begin(), best.inlier.end(), true) == 0 ||
      best.inliers < kMinMotionShare * n || !isFinite(best.T_2_1)) {
    return result;
  }
  result.T_2_1 = best.T_2_1;
  result.inlier = best.inlier;
  result.inverse_depth_1 = best.inverse_depth_1;
  result.median_parallax = medianParallax(x1, x2, best);
  result.status = result.median_parallax < kMinStartParallax ? TwoViewStatus::kTooLittleParallax
                  : ambiguousCandidate(candidates, n, kMaxSecondBestRatio)
                      ? TwoViewStatus::kAmbiguous
                      : TwoViewStatus::kOk;
  return result;
}

std::optional<RelativeRotation> TwoView::estimateRotation(
    const PinholeCamera& camera, const std::vector<Eigen::Vector2d>& u1,
    const std::vector<Eigen::Vector2d>& u2) const {
  if (u1.size() != u2.size() || u1.size() < kMinRotationMatches) return std::nullopt;
  const auto x1 = normalisedCoordinates(camera, u1), x2 = normalisedCoordinates(camera, u2);
  const double n = static_cast<double>(x1.size());
  const RotationFit rotation = fitRotation(x1, x2);
  const double support = rotation.support(kInlierThreshold);
  std::vector<Candidate> candidates;
  if (support <= kMaxSecondBestRatio * n) {  // else no motion can have so much more
    candidates = rankedCandidates(x1, x2, kInlierThreshold);
  }
  const double best_support = candidates.empty() ? 0 : n - candidates.front().cost;
  // Without parallax beyond the noise, any translation fits. With more, the rotation fitted alone
  // absorbs a part of it: up to three times what it leaves, when the camera looks to the side.
  if (candidates.empty() || support > kMaxSecondBestRatio * best_support) {
    if (support <= kMinMotionShare * n) return std::nullopt;
    return RelativeRotation{rotation.R_2_1, kInlierThreshold};
  }
  const Candidate& best = candidates.front();
  if (best.inliers < kMinMotionShare * n || !isFinite(best.T_2_1)) return std::nullopt;
  RelativeRotation result{best.T_2_1.linear(), kInlierThreshold};
  if (const Candidate* other = ambiguousCandidate(candidates, n, kMaxSecondBestRatio)) {
    result.sigma +=
        Eigen::AngleAxisd(best.T_2_1.linear().transpose() * other->T_2_1.linear()).angle();
  }
  return result;
}

}  // namespace ground_scale_vo
