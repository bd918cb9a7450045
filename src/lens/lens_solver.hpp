#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "lens/lens_segment.hpp"

namespace gsv {

/// Estimates the lens that all segments share.
///
/// The residuals alone give a covariance that is too small. Two errors are measured in addition:
///  - the dispersion of the scores of the tracks (cluster-robust covariance), which covers what the
///    noise model of a track misses;
///  - the field, a smooth displacement of the pixels that the lens model does not describe. It is
///    the same in all frames, so more frames do not average it out. The variance of its
///    coefficients is estimated from the drive by maximum likelihood. The field itself is not
///    estimated but enters the covariance as a set of consider parameters (Schmidt 1966).
class LensSolver {
 public:
  LensSolver(std::vector<LensSegment> segments, const LensEstimate& prior, const Lens& initial,
             const TrackNoise& noise)
      : segments_(std::move(segments)), prior_(prior), lens_(initial), noise_(noise) {}

  void setLens(const Lens& lens) { lens_ = lens; }
  /// Levenberg-Marquardt over poses, points and, if lens_is_free, the lens.
  void optimise(bool lens_is_free, int iterations);
  /// See LensSegment::rejectOutliers(); also estimates the noise from what is left.
  void rejectOutliers(double max_error_px, std::size_t min_observations);
  /// Moves the lens to the weighted mean of drive and prior, by their covariances: a few steps of
  /// Gauss-Newton. Precondition: optimise() has converged.
  LensEstimate combineWithPrior();

  const Lens& lens() const { return lens_; }
  const std::vector<LensSegment>& segments() const { return segments_; }
  /// Of the drive alone: the inverse covariance of the lens. Valid after combineWithPrior().
  const LensMatrix& information() const { return information_; }
  /// Standard deviation of the coefficients of the field [px]. Valid after combineWithPrior().
  double fieldSigma() const { return field_sigma_px_; }

 private:
  static constexpr int kField = LensSegment::kFieldParameters;
  struct System {
    Eigen::MatrixXd H;
    Eigen::VectorXd g;
    LensMatrix scores;
    LensMatrix A() const { return H.topLeftCorner<kLensParameters, kLensParameters>(); }
    Eigen::MatrixXd A_lf() const { return H.topRightCorner<kLensParameters, kField>(); }
    LensVector b() const { return g.head<kLensParameters>(); }
  };

  void estimateNoise();
  double cost(const Lens& lens, bool with_prior) const;
  System linearise();
  void measureErrors(const System& system);

  std::vector<LensSegment> segments_;
  const LensEstimate prior_;
  Lens lens_;
  TrackNoise noise_;
  LensMatrix information_ = LensMatrix::Zero();
  double field_sigma_px_ = 0, dispersion_ = 1;
};

}  // namespace gsv
