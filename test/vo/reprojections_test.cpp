#include "vo/reprojections.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ground_scale_vo {
namespace {

// Several landmarks are computed at once; their number is not a multiple.
TEST(Reprojections, TheCostIsInfiniteWhenAnyLandmarkIsTooClose) {
  constexpr std::size_t kLandmarks = 7;
  constexpr double kMinDepth = 0.1, kHuber = 100;
  const std::vector<Eigen::Vector3d> rays(kLandmarks, Eigen::Vector3d(0.2, -0.1, 1));
  // Seen from 1 unit farther ahead: q = ray + rho t.
  Eigen::Isometry3d T_o_a = Eigen::Isometry3d::Identity();
  T_o_a.translation().z() = -1;
  std::vector<Reprojections::Residual> residuals;
  for (std::size_t i = 0; i < kLandmarks; ++i) {
    residuals.push_back({0, i, i + 1, {0.4, -0.2}, 2});
  }
  residuals.back().x.x() += 0.3;
  Reprojections reprojections;
  reprojections.assign(residuals, rays, 1);
  const std::vector<double> depths(kLandmarks, 0.5);  // inverse
  const auto cost = [&](const std::vector<double>& inverse_depths) {
    return reprojections.cost(0, T_o_a, inverse_depths, kHuber, kMinDepth);
  };
  EXPECT_NEAR(cost(depths), 0.5 * std::pow(2 * 0.3, 2), 1e-12);
  for (std::size_t i = 0; i < kLandmarks; ++i) {
    std::vector<double> changed = depths;
    changed[i] = 0.89;
    EXPECT_TRUE(std::isfinite(cost(changed))) << i;
    changed[i] = 0.91;
    EXPECT_TRUE(std::isinf(cost(changed))) << i;
  }
}

}  // namespace
}  // namespace ground_scale_vo
