#include "ground_scale_vo/common/se3.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

Vector6d vector6(double a, double b, double c, double d, double e, double f) {
  Vector6d v;
  v << a, b, c, d, e, f;
  return v;
}

Eigen::Isometry3d examplePose() { return motionFrom(vector6(0.3, -0.5, 0.2, 1, -2, 3)); }

TEST(Se3, MotionHasRotationFirstThenTranslation) {
  const Eigen::Isometry3d T = motionFrom(vector6(0, 0, M_PI / 2, 1, 2, 3));
  EXPECT_TRUE((T.linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY(), 1e-15));
  EXPECT_EQ(T.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(motionFrom(Vector6d::Zero()).matrix(), Eigen::Matrix4d::Identity());
}

TEST(Se3, TheExponentialMapIsTheProductOfManySmallMotions) {
  const Vector6d delta = vector6(0.3, -0.8, 0.5, 1, -2, 3);
  constexpr int kSteps = 10000;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (int i = 0; i < kSteps; ++i) T = boxplus(T, delta / kSteps);
  // A step of 1 / n is wrong by |w| |v| / (2 n^2).
  const double tolerance = delta.head<3>().norm() * delta.tail<3>().norm() / 2 / kSteps;
  EXPECT_LT((exponentialMap(delta.head<3>(), delta.tail<3>()).matrix() - T.matrix()).norm(),
            2 * tolerance);
}

TEST(Se3, BoxplusAppliesTheIncrementInTheBodyFrame) {
  const Eigen::Isometry3d T = examplePose();
  const Vector6d delta = vector6(0.1, 0.2, -0.3, 0.5, -0.4, 0.1);
  const Eigen::Isometry3d moved = boxplus(T, delta);
  EXPECT_TRUE(moved.translation().isApprox(T.translation() + T.linear() * delta.tail<3>(), 1e-14));
  EXPECT_TRUE(
      (T.linear().transpose() * moved.linear()).isApprox(motionFrom(delta).linear(), 1e-14));
  EXPECT_EQ(boxplus(T, Vector6d::Zero()).matrix(), T.matrix());
}

TEST(Se3, AdjointTransformsATwistToTheOtherFrame) {
  const Eigen::Isometry3d T = examplePose();
  const Vector6d delta_b = 1e-5 * vector6(1, -2, 3, 0.5, 0.2, -0.7);
  // T exp(delta_b) = exp(adjoint(T) delta_b) T, to first order.
  const Eigen::Isometry3d right = boxplus(T, delta_b);
  const Eigen::Isometry3d left = motionFrom(adjoint(T) * delta_b) * T;
  EXPECT_LT((right.matrix() - left.matrix()).norm(), 1e-8);
  EXPECT_TRUE(adjoint(T.inverse()).isApprox(adjoint(T).inverse(), 1e-12));
}

}  // namespace
}  // namespace ground_scale_vo
