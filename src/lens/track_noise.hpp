#pragma once

#include <Eigen/Core>
#include <vector>

namespace gsv {

/// Errors of the observations of one track. They are correlated: a feature drifts on its surface as
/// its patch deforms, and all observations share the error of the patch that they are aligned to.
/// In keyframe k the error of each coordinate is a random walk that starts at the first observation
/// plus an independent part: covariance sigma^2 (delta_ij + walk min(k_i - k_0, k_j - k_0)).
/// Tracks differ in quality, so the whole track follows a Student t distribution; a moving object
/// gets a small weight.
struct TrackNoise {
  double sigma_px = 0.2;          ///< of the independent part
  double walk = 0.5;              ///< variance of the walk per keyframe [sigma_px^2]
  double degrees_of_freedom = 4;  ///< of the t distribution

  /// Inverse covariance in units of sigma_px^2, for one coordinate. keyframes: increasing.
  Eigen::MatrixXd information(const std::vector<std::size_t>& keyframes) const;

  /// chi2: squared residuals of the whole track, whitened, in units of sigma_px^2. redundancy:
  /// their number minus the parameters of the point.
  double weight(double chi2, int redundancy) const;
  double cost(double chi2, int redundancy) const;
};

}  // namespace gsv
