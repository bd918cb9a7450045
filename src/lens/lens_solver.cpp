#include "lens/lens_solver.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

constexpr double kFirstDamping = 1e-4, kLeastDamping = 1e-10, kLargestDamping = 1e4;
/// The optimisation ends when a step decreases the cost by less than this share, or moves a free
/// lens by less than this part of a standard deviation.
constexpr double kConvergedCost = 1e-4, kConvergedSigmas = 0.1;
constexpr int kCombinationSteps = 4;
/// Modes of the field with less than this share of the information of the best determined one are
/// those that poses, points and lens can absorb.
constexpr double kMinModeInformation = 1e-3;

/// Maximum-likelihood variance of zero-mean values that are measured with known variances, from the
/// squares of the measured values: the fixed point of the weighted moments.
double commonVariance(const std::vector<double>& squares, const std::vector<double>& variances) {
  if (squares.empty()) return 0;
  double result = *std::max_element(squares.begin(), squares.end());
  for (int i = 0; i < 100; ++i) {
    double sum = 0, weights = 0;
    for (std::size_t k = 0; k < squares.size(); ++k) {
      const double weight = 1 / ((result + variances[k]) * (result + variances[k]));
      sum += weight * (squares[k] - variances[k]);
      weights += weight;
    }
    result = std::max(0.0, sum / weights);
  }
  return result;
}

}  // namespace

void LensSolver::estimateNoise() {
  std::vector<double> variances;
  for (const LensSegment& segment : segments_) {
    for (const double variance : segment.variances(lens_)) variances.push_back(variance);
  }
  if (!variances.empty()) noise_.sigma_px = std::sqrt(median(&variances));
}

double LensSolver::cost(const Lens& lens, bool with_prior) const {
  double sum = 0;
  for (const LensSegment& segment : segments_) sum += segment.cost(lens, noise_);
  if (!with_prior) return sum;
  const LensVector delta = boxminus(lens, prior_.lens);
  return sum + 0.5 * delta.dot(prior_.covariance.ldlt().solve(delta));
}

void LensSolver::optimise(bool lens_is_free, int iterations) {
  const LensMatrix prior_information = prior_.covariance.inverse();
  double damping = kFirstDamping, current = cost(lens_, lens_is_free);
  for (int i = 0; i < iterations && damping < kLargestDamping; ++i) {
    LensMatrix A = prior_information;
    LensVector b = prior_information * boxminus(lens_, prior_.lens);
    for (LensSegment& segment : segments_) {
      const LensSegment::Reduced reduced = segment.reduce(lens_, noise_, damping);
      A += reduced.A;
      b += reduced.b;
    }
    const LensVector delta = lens_is_free ? LensVector(-A.ldlt().solve(b)) : LensVector::Zero();
    for (LensSegment& segment : segments_) segment.update(delta);
    const Lens next = boxplus(lens_, delta);
    const double next_cost = cost(next, lens_is_free);
    if (!(next_cost < current)) {
      for (LensSegment& segment : segments_) segment.undo();
      damping *= 10;
      continue;
    }
    const bool converged = lens_is_free ? delta.dot(A * delta) < kConvergedSigmas * kConvergedSigmas
                                        : current - next_cost < kConvergedCost * current;
    lens_ = next;
    current = next_cost;
    damping = std::max(damping / 10, kLeastDamping);
    if (converged) break;
  }
}

void LensSolver::rejectOutliers(double max_error_px, std::size_t min_observations) {
  for (LensSegment& segment : segments_) {
    segment.rejectOutliers(lens_, noise_, max_error_px, min_observations);
  }
  estimateNoise();
}

/// Of poses and points eliminated: the normal equations of lens and field, and the sum of the outer
/// products of the scores of the tracks.
LensSolver::System LensSolver::linearise() {
  constexpr int kAll = kLensParameters + kField;
  System system{Eigen::MatrixXd::Zero(kAll, kAll), Eigen::VectorXd::Zero(kAll), LensMatrix::Zero()};
  for (LensSegment& segment : segments_) {
    const LensSegment::Reduced reduced = segment.reduceWithField(lens_, noise_);
    system.H += reduced.A;
    system.g += reduced.b;
    for (const LensVector& score : reduced.scores) system.scores += score * score.transpose();
  }
  return system;
}

void LensSolver::measureErrors(const System& system) {
  const Eigen::LDLT<LensMatrix> A(system.A());
  dispersion_ = std::max(1.0, A.solve(system.scores).trace() / kLensParameters);
  // What remains of the field after the lens has adapted to it.
  const Eigen::MatrixXd A_lf = system.A_lf();
  const Eigen::MatrixXd H =
      system.H.bottomRightCorner<kField, kField>() - A_lf.transpose() * A.solve(A_lf);
  const Eigen::VectorXd g = system.g.tail<kField>() - A_lf.transpose() * A.solve(system.b());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(H);
  // The eigenvalues are in increasing order.
  const double min_information = kMinModeInformation * modes.eigenvalues()[kField - 1];
  std::vector<double> squares, variances;  // of the amplitudes of the modes [px^2]
  for (Eigen::Index k = 0; k < kField; ++k) {
    const double information = modes.eigenvalues()[k];
    if (information < min_information) continue;
    const double amplitude = modes.eigenvectors().col(k).dot(g) / information;
    squares.push_back(amplitude * amplitude);
    variances.push_back(dispersion_ / information);
  }
  field_sigma_px_ = std::sqrt(commonVariance(squares, variances));
}

LensEstimate LensSolver::combineWithPrior() {
  const LensMatrix prior_information = prior_.covariance.inverse();
  const System system = linearise();
  measureErrors(system);
  LensMatrix A = system.A();
  LensVector b = system.b();
  const LensMatrix score_covariance = dispersion_ * A + field_sigma_px_ * field_sigma_px_ *
                                                            system.A_lf() *
                                                            system.A_lf().transpose();
  const LensMatrix weight = score_covariance.ldlt().solve(A).transpose();
  information_ = weight * A;
  const LensMatrix information = information_ + prior_information;
  for (int i = 0;; ++i) {
    const LensVector delta =
        -information.ldlt().solve(weight * b + prior_information * boxminus(lens_, prior_.lens));
    for (LensSegment& segment : segments_) segment.update(delta);
    lens_ = boxplus(lens_, delta);
    if (i + 1 >= kCombinationSteps ||
        delta.dot(information * delta) < kConvergedSigmas * kConvergedSigmas) {
      return {lens_, information.inverse()};
    }
    b.setZero();
    for (LensSegment& segment : segments_) b += segment.reduce(lens_, noise_, 0).b;
  }
}

}  // namespace gsv
