#include "vo/pose.hpp"

#include <gtest/gtest.h>

#include <random>

#include "support/scene.hpp"

namespace gsv {
namespace {

using test::angleBetween;
using test::kObservationSigma;
using test::normalised;
using test::pose;

constexpr int kMapPoints = 300;
const Eigen::Isometry3d kOrigin = Eigen::Isometry3d::Identity();

/// noise: standard deviation in normalised image coordinates.
std::vector<PointObservation> observationsFrom(const Eigen::Isometry3d& T_w_c, double noise = 0) {
  std::mt19937 generator(51);
  std::normal_distribution<double> error(0, 1);
  std::vector<PointObservation> result;
  for (const Eigen::Vector3d& p : test::farPoints(kMapPoints)) {
    const Eigen::Vector2d x = normalised(T_w_c.inverse() * p) +
                              noise * Eigen::Vector2d(error(generator), error(generator));
    result.push_back({{p, Eigen::Vector3d::Zero()}, x, kObservationSigma});
  }
  return result;
}

void expectPose(const PoseEstimate& result, const Eigen::Isometry3d& T_w_c, double max_angle,
                double max_distance) {
  ASSERT_TRUE(result.ok);
  EXPECT_LT(angleBetween(result.T_w_c, T_w_c), max_angle);
  EXPECT_LT((result.T_w_c.translation() - T_w_c.translation()).norm(), max_distance);
  const Eigen::Matrix3d R = result.T_w_c.linear();
  EXPECT_TRUE((R.transpose() * R).isApprox(Eigen::Matrix3d::Identity(), 1e-12));
}

TEST(PoseEstimation, IsExactWithoutNoiseAndRobustAgainstWrongPredictionsAndOutliers) {
  const Eigen::Isometry3d T_w_c = pose({0.01, 0.05, -0.02}, {0.3, -0.1, 1.5});
  auto observations = observationsFrom(T_w_c);
  const auto exact = estimatePose(kOrigin, observations);
  expectPose(exact, T_w_c, 1e-8, 1e-7);
  EXPECT_EQ(exact.inliers, kMapPoints);
  // A point behind the camera counts for nothing, not even on the optical axis.
  const Eigen::Vector3d behind = T_w_c * Eigen::Vector3d(0, 0, -5);
  observations.push_back({{behind, Eigen::Vector3d::Zero()}, {0, 0}, kObservationSigma});
  const auto with_behind = estimatePose(kOrigin, observations);
  EXPECT_FALSE(with_behind.inlier.back());
  EXPECT_EQ(with_behind.inliers, kMapPoints);

  observations = observationsFrom(T_w_c, 0.0005);
  expectPose(estimatePose(pose({0, 0.6, 0}, {-5, 0, 8}), observations), T_w_c, 1e-3, 0.1);
  for (std::size_t i = 0; i < observations.size(); i += 4) observations[i].x.x() += 0.05;
  const auto robust = estimatePose(kOrigin, observations);
  expectPose(robust, T_w_c, 3e-4, 0.05);
  for (std::size_t i = 0; i < observations.size(); i += 4) EXPECT_FALSE(robust.inlier[i]);
}

// The covariance is that of a small motion (position, rotation) in camera axes. Several
// observations are computed at once, also when their number is not a multiple.
TEST(PoseEstimation, TheCovarianceMatchesTheErrorsOfThePoseWhateverTheirSigma) {
  const Eigen::Isometry3d T_w_c = pose({0.2, -0.5, 0.1}, {1, 2, -3});
  auto exact = observationsFrom(T_w_c);
  exact.resize(103);
  std::mt19937 generator(7);
  constexpr int kRuns = 300;
  for (const double relative_noise : {0.3, 1.0}) {
    std::normal_distribution<double> error(0, relative_noise * kObservationSigma);
    double nees = 0;
    for (int run = 0; run < kRuns; ++run) {
      auto observations = exact;
      for (auto& o : observations) o.x += Eigen::Vector2d(error(generator), error(generator));
      // Few wrong ones do not count.
      for (std::size_t i = 0; i < 10; ++i) observations[i].x.x() += 0.1;
      const auto result = estimatePose(T_w_c, observations);
      ASSERT_TRUE(result.ok);
      const Eigen::Isometry3d difference = T_w_c.inverse() * result.T_w_c;
      Vector6d motion;
      motion << difference.translation(), rotationVector(difference.linear());
      nees += motion.dot(result.covariance.ldlt().solve(motion)) / 6 / kRuns;
    }
    // The robust weights cost some of the efficiency of least squares.
    EXPECT_GT(nees, 0.7) << relative_noise;
    EXPECT_LT(nees, 1.5) << relative_noise;
  }
}

/// Observations from 3 units ahead, apart from those with i % 50 < share, which fit the origin, and
/// those with i % 50 >= first_outlier, which fit nothing.
std::vector<PointObservation> withMovingObjects(std::size_t share, std::size_t first_outlier = 50) {
  auto observations = observationsFrom(pose({0, 0, 0}, {0, 0, 3}), 0.0003);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    PointObservation& o = observations[i];
    if (i % 50 < share) o.x = normalised(o.p_w);
    if (i % 50 < first_outlier) continue;
    const double factor = 1.0 + 0.1 * static_cast<double>(i % 7);
    o.x += Eigen::Vector2d(0.05, i % 2 == 0 ? 0.1 : -0.1) * factor;
  }
  return observations;
}

// The points of vehicles at the same speed fit a pose without motion.
TEST(PoseEstimation, LeavesThePredictionOnlyForAPoseThatMuchMorePointsFit) {
  const Eigen::Isometry3d T_w_c = pose({0, 0, 0}, {0, 0, 3});
  expectPose(estimatePose(T_w_c, withMovingObjects(26)), T_w_c, 0.01, 0.05);
  expectPose(estimatePose(kOrigin, withMovingObjects(21)), T_w_c, 0.01, 0.1);
  // Slightly more points suffice when the prediction has too few for a pose.
  expectPose(estimatePose(kOrigin, withMovingObjects(18, 39)), T_w_c, 0.01, 0.1);
}

// Half of the points have a wrong depth on their ray from v, within their sigma, which is in world
// axes. The camera has moved forwards, or sideways along a diagonal of the image.
TEST(PoseEstimation, UncertainDepthsConstrainOnlyPerpendicularToTheEpipolarLine) {
  const Eigen::Isometry3d T_w_v = pose({0.3, 1.5, -0.4}, {5, 6, 7});
  for (const Eigen::Vector3d& moved : {Eigen::Vector3d(0.1, 0, 1), Eigen::Vector3d(0.7, 0.7, 0)}) {
    const Eigen::Isometry3d T_v_c = pose({0, 0.02, 0}, moved);
    auto observations = observationsFrom(T_v_c);
    for (std::size_t i = 0; i < observations.size(); ++i) {
      PointObservation& o = observations[i];
      if (i % 2 == 0) {
        o.sigma_w = T_w_v.linear() * (0.5 * o.p_w);
        o.p_w *= 1.4;
      }
      o.p_w = T_w_v * o.p_w;
    }
    const auto result = estimatePose(T_w_v, observations);
    expectPose(result, T_w_v * T_v_c, 0.01, 0.03);
    EXPECT_EQ(result.inliers, kMapPoints);
  }
}

TEST(PoseEstimation, ReportsWhenThereIsNoPose) {
  EXPECT_FALSE(estimatePose(kOrigin, {}).ok);
  auto observations = observationsFrom(kOrigin);
  std::mt19937 generator(61);
  std::uniform_real_distribution<double> anywhere(-0.5, 0.5);
  // A third of the points is consistent: enough points, but too small a share.
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (i % 3 > 0) observations[i].x = {anywhere(generator), anywhere(generator)};
  }
  EXPECT_FALSE(estimatePose(kOrigin, observations).ok);

  observations = observationsFrom(kOrigin);
  observations.resize(20);
  for (const int min_inliers : {20, 21}) {
    EXPECT_EQ(estimatePose(kOrigin, observations, min_inliers).ok, min_inliers == 20);
  }
}

}  // namespace
}  // namespace gsv
