#include "scale/direct/plane_solver.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo::direct {
namespace {

/// Limits the time spent on an estimate that does not converge.
constexpr int kMaxSolverIterations = 12;
/// Relative step of m at which the iteration has converged: far below the 0.5 % that the height is
/// known to in the best case.
constexpr double kConvergedStep = 2e-4;
/// From then on the robust scale is fixed, otherwise the weights and the scale may oscillate.
constexpr int kRobustScaleIterations = 5;
/// [standard deviations] Tuning constant of the Cauchy weights of whole patches.
constexpr double kPatchCauchyConstant = 2;
/// Typical mean correlation of patches that show nothing but road. A lower one means that part of
/// the patches show something else, and inflates the height's standard deviation.
constexpr double kRoadCorrelation = 0.92;

}  // namespace

DirectPlaneEstimator::Result PlaneSolver::solve(const std::vector<Patch>& patches,
                                                const std::vector<Reference>& references,
                                                const PatchMatcher& matcher,
                                                const NormalPrior& prior,
                                                const GroundPlane& initial,
                                                const Eigen::Vector3d& origin_c) {
  Result result;
  const double initial_height = initial.height;
  Eigen::Vector3d m = initial.n_c / initial_height;
  matches_.resize(patches.size() * kReferences);
  double robust_scale = 1;
  for (int iteration = 0; iteration < kMaxSolverIterations; ++iteration) {
    const bool linearise = iteration == 0;
    if (!matchPatches(patches, references, matcher, m.cast<float>(), linearise, &result)) {
      return result;
    }
    if (iteration < kRobustScaleIterations) {
      robust_scale = std::max(1.0, kMadToSigma * median(&normalised_shifts_));
    }
    accumulate(patches, references.size(), prior, m, initial_height, origin_c, robust_scale);
    PlaneEquations equations = marginaliseMotion(references.size());
    addPriors(prior, m, initial_height, &equations);
    const Eigen::Vector3d step = equations.H.ldlt().solve(equations.b).head<3>();
    if (!isFinite(step)) return result;
    if (step.norm() < kConvergedStep * m.norm()) {
      // Without this last step, so that the correlation and H are those of the accepted plane.
      accept(m, equations.H, initial_height, origin_c, &result);
      return result;
    }
    m += step;
    if (!(m.dot(prior.n_c) > 0)) return result;
  }
  return result;  // not converged
}

/// Matches all patches under the plane m. False when too few are valid.
bool PlaneSolver::matchPatches(const std::vector<Patch>& patches,
                               const std::vector<Reference>& references,
                               const PatchMatcher& matcher, const Eigen::Vector3f& m,
                               bool linearise, Result* result) {
  double correlation = 0, weights = 0;
  result->patches = 0;
  normalised_shifts_.clear();
  for (std::size_t i = 0; i < patches.size(); ++i) {
    if (patches[i].masked) continue;
    for (std::size_t k = 0; k < references.size(); ++k) {
      Match& match = matches_[i * kReferences + k];
      if (linearise) matcher.linearise(references[k], patches[i], m, &match);
      matcher.measure(references[k], patches[i], m, &match);
      if (!match.valid) continue;
      ++result->patches;
      correlation += patches[i].texture * match.correlation;
      weights += patches[i].texture;
      normalised_shifts_.push_back(std::abs(match.shift) / std::sqrt(shiftVariance(match, m)));
    }
  }
  if (result->patches < options_.min_patches || !(weights > 0)) return false;
  result->correlation = correlation / weights;
  return true;
}

/// From the pixels, and from the roughness of the road: the reference images see the same bump, so
/// its variance counts once for each.
double PlaneSolver::shiftVariance(const Match& match, const Eigen::Vector3f& m) const {
  const double roughness = options_.roughness_heights * m.dot(match.ray);
  return match.variance + kReferences * roughness * roughness;
}

/// Normal equations of all shifts with Cauchy weights, one system for each reference image.
void PlaneSolver::accumulate(const std::vector<Patch>& patches, std::size_t reference_count,
                             const NormalPrior& prior, const Eigen::Vector3d& m,
                             double initial_height, const Eigen::Vector3d& origin_c,
                             double robust_scale) {
  const Eigen::Vector3f m_float = m.cast<float>();
  for (JointEquations& joint : joint_) {
    joint.H.setZero();
    joint.b.setZero();
  }
  for (std::size_t i = 0; i < patches.size(); ++i) {
    if (patches[i].masked) continue;
    for (std::size_t k = 0; k < reference_count; ++k) {
      const Match& match = matches_[i * kReferences + k];
      if (!match.valid) continue;
      const Eigen::Vector3d ray = match.ray.cast<double>();
      const double q = m.dot(ray);
      // [camera heights] from the origin; the curved road lies lower by c x^2 / 2.
      const double ahead = prior.forward_c.dot(-ray / q - origin_c) / initial_height;
      const double across = prior.lateral().dot(-ray / q - origin_c) / initial_height;
      Vector11d jacobian;
      jacobian << ray, -0.5 * q * ahead * ahead, -0.5 * q * across * across, -q * ahead * across,
          match.motion.cast<double>();
      const double expected = shiftVariance(match, m_float) * robust_scale * robust_scale;
      const double shift = match.shift;
      const double weight =
          1 / (expected + shift * shift / (kPatchCauchyConstant * kPatchCauchyConstant));
      joint_[k].H.noalias() += weight * jacobian * jacobian.transpose();
      joint_[k].b += weight * shift * jacobian;
    }
  }
}

/// Schur complement: removes each reference's motion error, with its prior, from its equations.
PlaneSolver::PlaneEquations PlaneSolver::marginaliseMotion(std::size_t reference_count) {
  PlaneEquations plane;
  for (std::size_t k = 0; k < reference_count; ++k) {
    JointEquations& joint = joint_[k];
    joint.H.diagonal().segment<3>(6).array() += std::pow(options_.rotation_sigma_rad, -2);
    joint.H.diagonal().tail<2>().array() += std::pow(options_.direction_sigma_rad, -2);
    const Eigen::Matrix<double, 6, 5> cross = joint.H.topRightCorner<6, 5>();
    const Eigen::LDLT<Eigen::Matrix<double, 5, 5>> motion(joint.H.bottomRightCorner<5, 5>());
    plane.H += joint.H.topLeftCorner<6, 6>() - cross * motion.solve(cross.transpose());
    plane.b += joint.b.head<6>() - cross * motion.solve(joint.b.tail<5>());
  }
  return plane;
}

/// Pitch and roll of the normal, and zero curvatures.
void PlaneSolver::addPriors(const NormalPrior& prior, const Eigen::Vector3d& m,
                            double initial_height, PlaneEquations* equations) const {
  for (const auto& [axis, sigma] : {std::pair(prior.forward_c, prior.pitch_sigma),
                                    std::pair(prior.lateral(), prior.roll_sigma)}) {
    const Eigen::Vector3d jacobian = initial_height * axis / sigma;
    equations->H.topLeftCorner<3, 3>() += jacobian * jacobian.transpose();
    equations->b.head<3>() -= jacobian * jacobian.dot(m);
  }
  equations->H(3, 3) += std::pow(options_.curvature_sigma, -2);
  equations->H(4, 4) += std::pow(options_.crown_sigma, -2);
  equations->H(5, 5) += std::pow(options_.twist_sigma, -2);
}

/// Fills in the plane and its standard deviation, and decides whether it is accepted.
void PlaneSolver::accept(const Eigen::Vector3d& m, const Matrix6d& H, double initial_height,
                         const Eigen::Vector3d& origin_c, Result* result) const {
  const double height = (1 + m.dot(origin_c)) / m.norm();
  if (!(height > 0)) return;
  result->plane = {m.normalized(), height};
  // Of ln height by m.
  const Eigen::Vector3d gradient = origin_c / (1 + m.dot(origin_c)) - m / m.squaredNorm();
  const double relative_sigma =
      std::sqrt(gradient.dot(H.inverse().topLeftCorner<3, 3>() * gradient));
  const double inflation = std::max(1.0, (1 - result->correlation) / (1 - kRoadCorrelation));
  result->height_sigma = inflation * relative_sigma * height;
  const double change = std::abs(std::log(height / initial_height));
  if (result->correlation >= options_.min_correlation &&
      change <= std::log(options_.max_height_change) && relative_sigma <= options_.max_sigma) {
    result->status = ScaleReason::kNone;
  }
}

}  // namespace ground_scale_vo::direct
