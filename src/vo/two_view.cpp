#include "ground_scale_vo/vo/two_view.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/median.hpp"
#include "ground_scale_vo/vo/triangulation.hpp"

namespace ground_scale_vo {
namespace {

// RANSAC of both models. 1000 iterations are the default of cv::findEssentialMat.
constexpr double kConfidence = 0.9999;
constexpr int kMaxIterations = 1000;

/// Fraction of min_parallax that must remain after removing the best rotation to try a model: the
/// rotation that is fitted alone also absorbs part of a translation's flow.
constexpr double kMinParallaxFraction = 0.5;

/// Refits of the rotation to the matches below the median angle. Five converge.
constexpr int kRotationIterations = 5;

/// [plane distances] a shorter translation of a homography is a pure rotation.
constexpr double kMinTranslation = 1e-9;

/// [sigma] the inverse depth of a distant point may be this much below zero from noise.
constexpr double kMaxNegativeDepthSigmas = 2;

// Two candidates are the same motion when they differ by less. The essential matrix's and the
// homography's estimates of one motion do; the other solutions of their decompositions do not.
constexpr double kSameRotation = 0.02;   // [rad]
constexpr double kSameDirection = 0.15;  // [rad] of the translations

struct Candidate {
  Eigen::Isometry3d T_2_1 = Eigen::Isometry3d::Identity();
  bool planar = false;
  std::vector<bool> inlier;
  std::vector<double> inverse_depth_1;
  int inliers = 0;
  double cost = 0;  // sum of squared errors, truncated at 1, in units of the inlier threshold
};

Eigen::Matrix3d toEigen(const cv::Mat& m) {
  Eigen::Matrix3d result;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) result(r, c) = m.at<double>(r, c);
  return result;
}

Candidate candidate(const Eigen::Matrix3d& R, const Eigen::Vector3d& t, bool planar) {
  Candidate result;
  result.T_2_1.linear() = R;
  result.T_2_1.translation() = t.normalized();
  result.planar = planar;
  return result;
}

std::vector<Candidate> essentialCandidates(const std::vector<cv::Point2d>& x1,
                                           const std::vector<cv::Point2d>& x2, double threshold) {
  // OpenCV 4.5.1 and older have no argument for the iterations; their default is kMaxIterations.
  const cv::Mat E =
      cv::findEssentialMat(x1, x2, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, kConfidence, threshold);
  if (E.rows != 3 || E.cols != 3) return {};
  cv::Mat Ra, Rb, t;
  cv::decomposeEssentialMat(E, Ra, Rb, t);
  const Eigen::Vector3d t_eigen(t.at<double>(0), t.at<double>(1), t.at<double>(2));
  return {candidate(toEigen(Ra), t_eigen, false), candidate(toEigen(Ra), -t_eigen, false),
          candidate(toEigen(Rb), t_eigen, false), candidate(toEigen(Rb), -t_eigen, false)};
}

std::vector<Candidate> homographyCandidates(const std::vector<cv::Point2d>& x1,
                                            const std::vector<cv::Point2d>& x2, double threshold) {
  const cv::Mat H =
      cv::findHomography(x1, x2, cv::RANSAC, threshold, cv::noArray(), kMaxIterations, kConfidence);
  if (H.empty()) return {};
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(H, cv::Mat::eye(3, 3, CV_64F), rotations, translations, normals);
  std::vector<Candidate> result;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    const cv::Mat& t = translations[i];
    const Eigen::Vector3d t_eigen(t.at<double>(0), t.at<double>(1), t.at<double>(2));
    if (t_eigen.norm() < kMinTranslation) continue;
    result.push_back(candidate(toEigen(rotations[i]), t_eigen, true));
    result.push_back(candidate(toEigen(rotations[i]), -t_eigen, true));
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
    const Eigen::Vector3d p2 = c->T_2_1.linear() * ray + point->value * c->T_2_1.translation();
    const double error = (p2.head<2>() / p2.z() - observed).norm() / threshold;
    if (error > 1) continue;
    c->cost += error * error - 1;
    c->inlier[i] = point->value > 0;
    c->inverse_depth_1[i] = point->value;
    ++c->inliers;
  }
}

/// Median angle between the rays after removing the best rotation (Kabsch's algorithm, repeated on
/// the better half).
double parallaxAfterRotation(const std::vector<cv::Point2d>& x1,
                             const std::vector<cv::Point2d>& x2) {
  std::vector<Eigen::Vector3d> rays1, rays2;
  for (std::size_t i = 0; i < x1.size(); ++i) {
    rays1.push_back(Eigen::Vector3d(x1[i].x, x1[i].y, 1).normalized());
    rays2.push_back(Eigen::Vector3d(x2[i].x, x2[i].y, 1).normalized());
  }
  std::vector<double> angles(x1.size(), 0.0);
  double limit = 1;
  for (int iteration = 0; iteration < kRotationIterations; ++iteration) {
    Eigen::Matrix3d C = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < rays1.size(); ++i) {
      if (angles[i] <= limit) C += rays2[i] * rays1[i].transpose();
    }
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(C, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d R = svd.matrixU() * svd.matrixV().transpose();
    if (R.determinant() < 0) {
      R = svd.matrixU() * Eigen::Vector3d(1, 1, -1).asDiagonal() * svd.matrixV().transpose();
    }
    for (std::size_t i = 0; i < rays1.size(); ++i) {
      const Eigen::Vector3d rotated = R * rays1[i];
      angles[i] = std::atan2(rotated.cross(rays2[i]).norm(), rotated.dot(rays2[i]));
    }
    limit = median(angles);
  }
  return limit;
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
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  return candidates;
}

/// True if the best motion that differs from candidates.front() has nearly as much support
/// (n minus the cost).
bool isAmbiguous(const std::vector<Candidate>& candidates, double n, double max_ratio) {
  const Candidate& best = candidates.front();
  for (const Candidate& other : candidates) {
    if (sameMotion(best, other)) continue;
    return n - other.cost > max_ratio * (n - best.cost);
  }
  return false;
}

}  // namespace

void TwoView::Options::validate() const { visitParameters(*this, RangeCheck("two_view/")); }

TwoView::TwoView(const Options& options) : options_(options) { options_.validate(); }

TwoView::Result TwoView::estimate(const PinholeCamera& camera,
                                  const std::vector<Eigen::Vector2d>& u1,
                                  const std::vector<Eigen::Vector2d>& u2) const {
  Result result;
  if (u1.size() != u2.size() || static_cast<int>(u1.size()) < options_.min_matches) {
    result.status = TwoViewStatus::kTooFewMatches;
    return result;
  }
  std::vector<cv::Point2d> x1, x2;  // normalised image coordinates
  for (std::size_t i = 0; i < u1.size(); ++i) {
    const Eigen::Vector3d a = camera.ray(u1[i]), b = camera.ray(u2[i]);
    x1.emplace_back(a.x(), a.y());
    x2.emplace_back(b.x(), b.y());
  }
  if (parallaxAfterRotation(x1, x2) < kMinParallaxFraction * options_.min_parallax) {
    result.status = TwoViewStatus::kTooLittleParallax;
    return result;
  }

  const auto candidates = rankedCandidates(x1, x2, options_.inlier_threshold);
  if (candidates.empty()) return result;
  const Candidate& best = candidates.front();
  const double n = static_cast<double>(x1.size());
  if (std::count(best.inlier.begin(), best.inlier.end(), true) == 0 ||
      best.inliers < options_.min_inlier_share * n || !isFinite(best.T_2_1)) {
    return result;
  }
  result.T_2_1 = best.T_2_1;
  result.inlier = best.inlier;
  result.inverse_depth_1 = best.inverse_depth_1;
  result.planar = best.planar;
  result.median_parallax = medianParallax(x1, x2, best);
  result.status = result.median_parallax < options_.min_parallax ? TwoViewStatus::kTooLittleParallax
                  : isAmbiguous(candidates, n, options_.max_second_best_ratio)
                      ? TwoViewStatus::kAmbiguous
                      : TwoViewStatus::kOk;
  return result;
}

}  // namespace ground_scale_vo
