#include "lens/track_noise.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace gsv {

Eigen::MatrixXd TrackNoise::information(const std::vector<std::size_t>& keyframes) const {
  const auto n = static_cast<Eigen::Index>(keyframes.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      const std::size_t first = keyframes[static_cast<std::size_t>(std::min(i, j))];
      covariance(i, j) += walk * static_cast<double>(first - keyframes.front());
    }
  }
  return covariance.inverse();
}

double TrackNoise::weight(double chi2, int redundancy) const {
  return (degrees_of_freedom + redundancy) / (degrees_of_freedom + chi2);
}

double TrackNoise::cost(double chi2, int redundancy) const {
  return 0.5 * (degrees_of_freedom + redundancy) * std::log1p(chi2 / degrees_of_freedom);
}

}  // namespace gsv
