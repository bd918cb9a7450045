#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "scripted_run.hpp"

namespace gsv {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;

Eigen::Isometry3d rotated(Eigen::Isometry3d T, const Eigen::Vector3d& w) {
  T.linear() = Eigen::AngleAxisd(w.norm(), w.normalized()) * T.linear();
  return T;
}

/// A drive along z with curves, and a simulated odometry whose errors have the published
/// covariance.
class SimulatedRun {
 public:
  /// A metre per pose. excess: factor of the errors over the published standard deviations.
  /// frames_per_pose: more than one with a standstill after each metre.
  SimulatedRun(unsigned seed, int poses, double excess = 1, int frames_per_pose = 1)
      : random_(seed) {
    constexpr double kPosition = 0.02, kRotation = 0.002;
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
        appendFrame(&record_, Eigen::Isometry3d::Identity(), estimate, P);
        truth_.push_back(truth);
      }
    }
  }

  const RunRecord& record() const { return record_; }
  const Poses& truth() const { return truth_; }

 private:
  Eigen::Vector3d normal(double sigma) {
    std::normal_distribution<double> distribution(0, sigma);
    return {distribution(random_), distribution(random_), distribution(random_)};
  }
  std::mt19937 random_;
  RunRecord record_;
  Poses truth_;
};

/// Means over many runs.
CovarianceMetrics::Length mean(std::size_t length, double excess) {
  constexpr int kRuns = 40;
  CovarianceMetrics::Length sum;
  for (unsigned seed = 0; seed < kRuns; ++seed) {
    const SimulatedRun run(seed, 130, excess);
    const CovarianceMetrics metrics = computeCovarianceMetrics(run.record(), run.truth());
    EXPECT_EQ(metrics.by_length.size(), 3u);
    if (metrics.by_length.size() != 3) return sum;
    sum.length_m = metrics.by_length[length].length_m;
    sum.nees_per_dof += metrics.by_length[length].nees_per_dof / kRuns;
    sum.within_2_sigma += metrics.by_length[length].within_2_sigma / kRuns;
  }
  return sum;
}

TEST(CovarianceMetrics, AConsistentCovarianceHasANeesOfOne) {
  for (const std::size_t length : {0u, 1u, 2u}) {
    const CovarianceMetrics::Length result = mean(length, 1);
    EXPECT_EQ(result.length_m, std::vector<double>({10, 50, 100})[length]);
    EXPECT_NEAR(result.nees_per_dof, 1, 0.1) << result.length_m;
    EXPECT_NEAR(result.within_2_sigma, 0.954, 0.02) << result.length_m;
  }
}

TEST(CovarianceMetrics, AnOverconfidentCovarianceHasALargerNees) {
  const CovarianceMetrics::Length result = mean(0, 2);
  EXPECT_NEAR(result.nees_per_dof, 4, 0.4);
  EXPECT_LT(result.within_2_sigma, 0.8);
}

TEST(CovarianceMetrics, HasTheLengthsThatTheDriveCovers) {
  // A standstill after each metre adds no segments.
  for (const int frames_per_pose : {1, 5}) {
    const SimulatedRun run(1, 60, 1, frames_per_pose);
    const CovarianceMetrics metrics = computeCovarianceMetrics(run.record(), run.truth());
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
  for (const RunFrame& frame : run.record().frames()) truth.push_back(turned * frame.T_o_c);
  EXPECT_LT(relativePoseError(run.record(), truth, 1, 2).error.norm(), 1e-12);
}

/// Of a step of 1 m along the optical axis, whose earlier and later pose have these variances on
/// the diagonal, and the heading yaw.
Matrix6d relativeCovariance(double earlier, double later, double yaw = 0,
                            const GroundTruthAccuracy& accuracy = {}) {
  RunRecord record;
  Poses truth;
  for (const double variance : {earlier, later}) {
    Eigen::Isometry3d T(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()));
    T.translate(static_cast<double>(truth.size()) * Eigen::Vector3d::UnitZ());
    truth.push_back(T);
    appendFrame(&record, T, T, variance * Matrix6d::Identity());
  }
  return relativePoseError(record, truth, 0, 1, accuracy).covariance;
}

// An error of the orientation of the ground truth moves the later position across the motion.
TEST(RelativePoseError, CovarianceOfTheGroundTruthIsInTheAxesOfTheOdometry) {
  const auto covariance = [](double yaw, double rotation_sigma) {
    return relativeCovariance(0.01, 1, yaw, {0, rotation_sigma, 0});
  };
  const auto ofGroundTruth = [&](double yaw) {
    return Eigen::Vector3d((covariance(yaw, 0.1) - covariance(yaw, 0)).diagonal().head<3>());
  };
  EXPECT_LT((ofGroundTruth(0) - Eigen::Vector3d(0.01, 0.01, 0)).norm(), 1e-12);
  EXPECT_LT((ofGroundTruth(M_PI / 2) - Eigen::Vector3d(0, 0.01, 0.01)).norm(), 1e-12);
}

TEST(RelativePoseError, ContainsTheCovarianceOfTheGroundTruth) {
  const auto expectAdded = [](const GroundTruthAccuracy& accuracy, const Vector6d& variances) {
    const Matrix6d added = relativeCovariance(0.01, 1, 0, accuracy) - relativeCovariance(0.01, 1);
    EXPECT_LT((added.diagonal() - variances).norm(), 1e-12) << added;
  };
  Vector6d position, rotation, alignment;
  position << 0.02, 0.02, 0.02, 0, 0, 0;        // of both poses
  rotation << 0.01, 0.01, 0, 0.02, 0.02, 0.02;  // of the first one, across the step; of both
  alignment << 0.01, 0.01, 0, 0, 0, 0;
  expectAdded({0.1, 0, 0}, position);
  expectAdded({0, 0.1, 0}, rotation);
  expectAdded({0, 0, 0.1}, alignment);
}

}  // namespace
}  // namespace gsv
