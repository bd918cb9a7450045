#include "correlated_mean.hpp"

#include <cmath>

namespace ground_scale_vo {
namespace {

/// Two-sided 95 % quantile of Student's t distribution: Cornish-Fisher expansion about the normal
/// distribution's, within 5 % from 3 degrees of freedom on.
double studentFactor(double freedom) {
  constexpr double z = 1.959964;
  const double z3 = z * z * z, z5 = z3 * z * z;
  return z + (z3 + z) / (4 * freedom) + (5 * z5 + 16 * z3 + 3 * z) / (96 * freedom * freedom);
}

}  // namespace

HeightCalibration::Estimate correlatedMean(const std::vector<double>& values,
                                           const std::vector<double>& weights) {
  const std::size_t n = values.size();
  double sum = 0, weight = 0;
  for (std::size_t i = 0; i < n; ++i) {
    sum += weights[i] * values[i];
    weight += weights[i];
  }
  HeightCalibration::Estimate mean;
  mean.value = sum / weight;
  const auto residual = [&](std::size_t i) {
    return weights[i] / weight * (values[i] - mean.value);
  };
  const auto autocovariance = [&](std::size_t lag) {
    double products = 0;
    for (std::size_t i = lag; i < n; ++i) products += residual(i) * residual(i - lag);
    return products;
  };
  double variance = autocovariance(0);
  for (std::size_t lag = 1; lag <= n / 3; ++lag) {
    const double covariance = autocovariance(lag);
    if (covariance <= 0) break;
    variance += 2 * covariance;
  }
  const double freedom = static_cast<double>(n - 1);
  mean.sigma = std::sqrt(variance * static_cast<double>(n) / freedom);
  mean.factor95 = studentFactor(freedom);
  return mean;
}

}  // namespace ground_scale_vo
