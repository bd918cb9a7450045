#include "calibration/correlated_mean.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ground_scale_vo {
namespace {

TEST(CorrelatedMean, IsWeighted) {
  EXPECT_DOUBLE_EQ(correlatedMean({1, 2, 5}, {1, 1, 2}).value, 3.25);
  // The weighted residuals are -3/8 and 3/8. Two values have one degree of freedom.
  EXPECT_DOUBLE_EQ(correlatedMean({1, 3}, {1, 3}).sigma, std::sqrt(2 * 9. / 64 * 2));
}

// The residuals over the number of values are -3/8, -1/8, 1/8, 3/8: their squares sum up to 5/16,
// the products of neighbours to 5/64. Four values have three degrees of freedom.
TEST(CorrelatedMean, ItsSigmaContainsTheCorrelationOfNeighbours) {
  const auto mean = correlatedMean({1, 2, 3, 4}, {1, 1, 1, 1});
  EXPECT_DOUBLE_EQ(mean.sigma, std::sqrt((5. / 16 + 2 * 5. / 64) * 4 / 3));
  EXPECT_NEAR(mean.factor95, 3.182, 0.05 * 3.182);
  // Neighbours with errors of opposite sign are taken as independent.
  const auto alternating = correlatedMean({1, 4, 2, 3}, {1, 1, 1, 1});
  EXPECT_DOUBLE_EQ(alternating.sigma, std::sqrt(5. / 16 * 4 / 3));
  // Beyond the first lag without a positive correlation there is none: here the residuals over the
  // number of values are -1/6 and 1/6, and those at a distance of two are equal.
  const auto longer = correlatedMean({1, 3, 1, 3, 1, 3}, {1, 1, 1, 1, 1, 1});
  EXPECT_DOUBLE_EQ(longer.sigma, std::sqrt(1. / 6 * 6 / 5));
}

}  // namespace
}  // namespace ground_scale_vo
