#include "ground_scale_vo/evaluation/metrics.hpp"
#include "scripted_run.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;

Eigen::Isometry3d rotated(Eigen::Isometry3d T, const Eigen::Vector3d& w) {
  T.linear() = Eigen::AngleAxisd(w.norm(), w.normalized()) * T.linear();
  return T;
}

/// A drive along z with curves, and a simulated odometry whose errors have the published
/// covariance.
struct SimulatedRun {
  /// A metre per pose. excess: factor of the errors over the published standard deviations.
  /// frames_per_pose: more than one with a standstill after each metre.
  SimulatedRun(unsigned seed, int poses, double excess = 1, int frames_per_pose = 1) {
    constexpr double kPosition = 0.02, kRotation = 0.002;
    std::mt19937 random(seed);
    const auto normal = [&](double sigma) -> Eigen::Vector3d {
      std::normal_distribution<double> distribution(0, sigma);
      return {distribution(random), distribution(random), distribution(random)};
    };
    Eigen::Isometry3d truth = Eigen::Isometry3d::Identity(), estimate = truth;
    Matrix6d P = Matrix6d::Zero();
    for (int i = 0; i < poses; ++i) {
      if (i > 0) {
        Eigen::Isometry3d step = Eigen::Isometry3d::Identity();
        step.translation().z() = 1;
        step.linear() =
            Eigen::AngleAxisd(0.05 * std::sin(0.1 * i), Eigen::Vector3d::UnitY()).matrix();
        truth = truth * step;
        const Eigen::Vector3d before = estimate.translation();
        estimate = estimate * step;
        estimate.translation() += normal(kPosition * excess);
        const Eigen::Vector3d step_o = estimate.translation() - before;
        estimate = rotated(estimate, normal(kRotation * excess));
        Matrix6d F = Matrix6d::Identity();
        F.topRightCorner<3, 3>() = -skew(step_o);
        P = F * P * F.transpose();
        P.diagonal().head<3>().array() += kPosition * kPosition;
        P.diagonal().tail<3>().array() += kRotation * kRotation;
      }
      for (int k = 0; k < frames_per_pose; ++k) {
        appendFrame(&record, Eigen::Isometry3d::Identity(), estimate, P);
        truth_poses.push_back(truth);
      }
    }
  }

  CovarianceMetrics metrics() const { return computeCovarianceMetrics(record, truth_poses); }

  RunRecord record;
  Poses truth_poses;
};

// Of a consistent and an overconfident covariance; means over many runs.
TEST(CovarianceMetrics, TheNeesIsTheSquareOfTheExcessOfTheErrors) {
  constexpr int kRuns = 40;
  for (const double excess : {1.0, 2.0}) {
    CovarianceMetrics::Length sums[3];
    for (unsigned seed = 0; seed < kRuns; ++seed) {
      const auto by_length = SimulatedRun(seed, 130, excess).metrics().by_length;
      ASSERT_EQ(by_length.size(), 3u);
      for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(by_length[i].length_m, (std::vector<double>{10, 50, 100})[i]);
        sums[i].nees_per_dof += by_length[i].nees_per_dof / kRuns;
        sums[i].within_2_sigma += by_length[i].within_2_sigma / kRuns;
      }
    }
    EXPECT_NEAR(sums[0].nees_per_dof, excess * excess, 0.1 * excess * excess);
    EXPECT_LT(sums[0].within_2_sigma, excess == 1 ? 0.974 : 0.8);
    for (const auto& sum : sums) {
      if (excess > 1) continue;
      EXPECT_NEAR(sum.nees_per_dof, 1, 0.1);
      EXPECT_NEAR(sum.within_2_sigma, 0.954, 0.02);
    }
  }
}

TEST(CovarianceMetrics, HasTheLengthsThatTheDriveCovers) {
  // A standstill after each metre adds no segments.
  for (const int frames_per_pose : {1, 5}) {
    const CovarianceMetrics metrics = SimulatedRun(1, 60, 1, frames_per_pose).metrics();
    ASSERT_EQ(metrics.by_length.size(), 2u);
    EXPECT_EQ(metrics.by_length[0].length_m, 10);
    EXPECT_EQ(metrics.by_length[0].segments, 49);  // the end is farther than 10 m
    EXPECT_EQ(metrics.by_length[1].length_m, 50);
    EXPECT_EQ(metrics.by_length[1].segments, 9);
  }
}

TEST(CovarianceMetrics, TheFirstMetricPoseIsADistanceInMetres) {
  RunRecord record;
  Poses truth;
  for (std::uint32_t i = 0; i < 3; ++i) {
    truth.emplace_back(Eigen::Translation3d(0, 0, 2.5 * i));
    const Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();
    appendFrame(&record, origin, i == 2 ? std::optional(origin) : std::nullopt, Matrix6d::Zero());
    EXPECT_EQ(std::isfinite(computeCovarianceMetrics(record, truth).first_metric_pose_m), i == 2);
  }
  const CovarianceMetrics metrics = computeCovarianceMetrics(record, truth);
  EXPECT_EQ(metrics.first_metric_pose_m, 5.0);
  EXPECT_TRUE(metrics.by_length.empty());
  EXPECT_THROW(computeCovarianceMetrics(record, {}), OptionError);
}

TEST(RelativePoseError, AnEarlierErrorOfTheHeadingIsNoErrorOfTheMotion) {
  const SimulatedRun run(1, 3);
  const Eigen::Isometry3d turned = rotated(Eigen::Isometry3d::Identity(), {0.1, 0.2, 0.3});
  Poses truth;
  for (const RunFrame& frame : run.record.frames()) truth.push_back(turned * frame.T_o_c);
  EXPECT_LT(relativePoseError(run.record, truth, 1, 2).error.norm(), 1e-12);
}

/// Of a step of 1 m along the optical axis, with the heading yaw.
Matrix6d relativeCovariance(double yaw, const GroundTruthAccuracy& accuracy) {
  RunRecord record;
  Poses truth;
  for (const double variance : {0.01, 1.0}) {
    Eigen::Isometry3d T(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()));
    T.translate(static_cast<double>(truth.size()) * Eigen::Vector3d::UnitZ());
    truth.push_back(T);
    appendFrame(&record, T, T, variance * Matrix6d::Identity());
  }
  return relativePoseError(record, truth, 0, 1, accuracy).covariance;
}

// Of both poses, in the axes of the odometry: an error of the orientation of the first one moves
// the later position across the step.
TEST(RelativePoseError, ContainsTheCovarianceOfTheGroundTruth) {
  const struct {
    double yaw;
    GroundTruthAccuracy accuracy;
    std::array<double, 6> variances;
  } kCases[] = {{0, {0.1, 0, 0}, {0.02, 0.02, 0.02, 0, 0, 0}},
                {0, {0, 0.1, 0}, {0.01, 0.01, 0, 0.02, 0.02, 0.02}},
                {M_PI / 2, {0, 0.1, 0}, {0, 0.01, 0.01, 0.02, 0.02, 0.02}},
                {0, {0, 0, 0.1}, {0.01, 0.01, 0, 0, 0, 0}}};
  for (const auto& c : kCases) {
    const Matrix6d added =
        relativeCovariance(c.yaw, c.accuracy) - relativeCovariance(c.yaw, GroundTruthAccuracy());
    const Eigen::Map<const Vector6d> expected(c.variances.data());
    EXPECT_LT((added.diagonal() - expected).norm(), 1e-12) << added;
  }
}

}  // namespace
}  // namespace gsv
