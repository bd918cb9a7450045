#include "correlated_mean.hpp"

#include <cmath>

namespace ground_scale_vo {
namespace {

/// 97.5 % quantile of Student's t (two-sided 95 %), Cornish-Fisher expansion; error < 5 % for >= 3
/// degrees of freedom.
double studentT975(double degrees_of_freedom) {
  constexpr double z = 1.959964;
  const double z3 = z * z * z, z5 = z3 * z * z;
  return z + (z3 + z) / (4 * degrees_of_freedom) +
         (5 * z5 + 16 * z3 + 3 * z) / (96 * degrees_of_freedom * degrees_of_freedom);
}

}  // namespace

HeightCalibration::Estimate correlatedMean(const std::vector<double>& values,
                                           const std::vector<double>& weights) {
  const std::size_t n = values.size();
  double sum = 0, total_weight = 0;
  for (std::size_t i = 0; i < n; ++i) {
    sum += weights[i] * values[i];
    total_weight += weights[i];
  }
  HeightCalibration::Estimate mean;
  mean.value = sum / total_weight;
  const auto weightedResidual = [&](std::size_t i) {
    return weights[i] / total_weight * (values[i] - mean.value);
  };
  const auto autocovariance = [&](std::size_t lag) {
    double products = 0;
    for (std::size_t i = lag; i < n; ++i) {
      products += weightedResidual(i) * weightedResidual(i - lag);
    }
    return products;
  };
  double variance = autocovariance(0);
  for (std::size_t lag = 1; lag <= n / 3; ++lag) {
    const double covariance = autocovariance(lag);
    if (covariance <= 0) break;
    variance += 2 * covariance;
  }
  const double degrees_of_freedom = static_cast<double>(n - 1);
  mean.sigma = std::sqrt(variance * static_cast<double>(n) / degrees_of_freedom);
  mean.factor95 = studentT975(degrees_of_freedom);
  return mean;
}

}  // namespace ground_scale_vo
