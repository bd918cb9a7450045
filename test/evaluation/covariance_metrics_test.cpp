#include "ground_scale_vo/evaluation/covariance_metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
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
  explicit SimulatedRun(unsigned seed, int poses, double excess = 1, int frames_per_pose = 1)
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
        append(estimate, P);
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
  void append(const Eigen::Isometry3d& T_o_c, const Matrix6d& covariance) {
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(record_.frames().size());
    vo.frame.status = VoStatus::kTracking;
    ScaleRecovery::Output scale;
    scale.pose.emplace();
    scale.pose->T_o_c = T_o_c;
    scale.pose->covariance = covariance;
    record_.append(vo, scale);
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
    sum.segments = metrics.by_length[length].segments;
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
  EXPECT_NEAR(mean(0, 2).nees_per_dof, 4, 0.4);
  EXPECT_LT(mean(0, 2).within_2_sigma, 0.8);
}

TEST(CovarianceMetrics, HasTheLengthsThatTheDriveCovers) {
  const SimulatedRun run(1, 60);
  const CovarianceMetrics metrics = computeCovarianceMetrics(run.record(), run.truth());
  ASSERT_EQ(metrics.by_length.size(), 2u);
  EXPECT_EQ(metrics.by_length[0].length_m, 10);
  EXPECT_EQ(metrics.by_length[0].segments, 49);  // frames 0 to 48: the end is farther than 10 m
  EXPECT_EQ(metrics.by_length[1].length_m, 50);
  EXPECT_EQ(metrics.by_length[1].segments, 9);
  EXPECT_EQ(metrics.first_metric_pose_m, 0.0);
}

TEST(CovarianceMetrics, AStandstillAddsNoSegments) {
  const SimulatedRun driving(1, 60), stopping(1, 60, 1, 5);
  const auto expected = computeCovarianceMetrics(driving.record(), driving.truth()).by_length;
  const auto by_length = computeCovarianceMetrics(stopping.record(), stopping.truth()).by_length;
  ASSERT_EQ(by_length.size(), expected.size());
  EXPECT_EQ(by_length[0].segments, expected[0].segments);
  EXPECT_EQ(by_length[1].segments, expected[1].segments);
}

TEST(CovarianceMetrics, WithoutAMetricPoseThereIsNone) {
  RunRecord record;
  record.append({}, {});
  const CovarianceMetrics metrics =
      computeCovarianceMetrics(record, {Eigen::Isometry3d::Identity()});
  EXPECT_TRUE(metrics.by_length.empty());
  EXPECT_FALSE(metrics.first_metric_pose_m);
  EXPECT_THROW(computeCovarianceMetrics(record, {}), OptionError);
}

TEST(CovarianceMetrics, TheFirstMetricPoseIsADistanceInMetres) {
  RunRecord record;
  Poses truth;
  for (std::uint32_t i = 0; i < 3; ++i) {
    truth.emplace_back(Eigen::Translation3d(0, 0, 2.5 * i));
    VisualOdometry::Output vo;
    vo.frame.sequence = i;
    ScaleRecovery::Output scale;
    if (i == 2) scale.pose.emplace();
    record.append(vo, scale);
  }
  EXPECT_EQ(computeCovarianceMetrics(record, truth).first_metric_pose_m, 5);
}

TEST(RelativePoseError, AnEarlierErrorOfTheHeadingIsNoErrorOfTheMotion) {
  const SimulatedRun run(1, 3);
  Poses truth;
  for (const RunFrame& frame : run.record().frames()) {
    truth.push_back(rotated(frame.T_o_c, {0.1, 0.2, 0.3}));
    truth.back().translation() = Eigen::AngleAxisd(Eigen::Vector3d(0.1, 0.2, 0.3).norm(),
                                                   Eigen::Vector3d(0.1, 0.2, 0.3).normalized()) *
                                 frame.T_o_c.translation();
  }
  EXPECT_LT(relativePoseError(run.record(), truth, 1, 2).error.norm(), 1e-12);
}

/// Of a step of 1 m along the optical axis, whose earlier and later pose have these variances on
/// the diagonal, and the heading yaw.
Matrix6d relativeCovariance(double earlier, double later, double yaw = 0,
                            const GroundTruthAccuracy& accuracy = {}) {
  RunRecord record;
  Poses truth;
  for (const double variance : {earlier, later}) {
    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(truth.size());
    vo.frame.status = VoStatus::kTracking;
    ScaleRecovery::Output scale;
    scale.pose.emplace();
    scale.pose->T_o_c.rotate(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()));
    scale.pose->T_o_c.translate(static_cast<double>(truth.size()) * Eigen::Vector3d::UnitZ());
    scale.pose->covariance = variance * Matrix6d::Identity();
    truth.push_back(scale.pose->T_o_c);
    record.append(vo, scale);
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

// The relative motion turns against an error of the earlier orientation, and swings with it.
TEST(RelativePoseError, CorrelatesPositionAndRotationOfTheGroundTruth) {
  const Matrix6d P = relativeCovariance(0.01, 1, 0, {0, 0.1, 0}) - relativeCovariance(0.01, 1);
  const Eigen::Matrix3d expected = -0.01 * skew(Eigen::Vector3d::UnitZ());
  EXPECT_LT((P.topRightCorner<3, 3>() - expected).norm(), 1e-12);
  EXPECT_LT((P.bottomLeftCorner<3, 3>() + expected).norm(), 1e-12);
}

TEST(RelativePoseError, AddsTheCovariancesWhenTheLaterPoseIsKnownBetter) {
  // The rotation of the earlier pose moves the later one: across the motion by a metre per radian.
  const double earlier = 0.04;
  Vector6d moved = Vector6d::Constant(earlier);
  moved.head<2>().array() += earlier;
  for (const double later : {0.01, 0.0401, 1.0}) {
    const double sign = later > 0.5 ? -1 : 1;
    const Vector6d expected = Vector6d::Constant(later) + sign * moved;
    EXPECT_LT((relativeCovariance(earlier, later).diagonal() - expected).norm(), 1e-12) << later;
  }
}

/// A run without errors over a curve, and ground truth with the errors of `accuracy`.
double meanNeesOfNoisyGroundTruth(const GroundTruthAccuracy& accuracy,
                                  const GroundTruthAccuracy& assumed) {
  constexpr int kRuns = 400;
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, 1);
  const auto vector = [&](double sigma) -> Eigen::Vector3d {
    return sigma * Eigen::Vector3d(normal(random), normal(random), normal(random));
  };
  const SimulatedRun run(1, 40, 0);
  double sum = 0;
  for (int k = 0; k < kRuns; ++k) {
    Eigen::Isometry3d alignment = Eigen::Isometry3d::Identity();
    alignment = rotated(alignment, vector(accuracy.alignment_sigma));
    Poses truth;
    for (Eigen::Isometry3d T : run.truth()) {
      T = rotated(alignment * T * alignment.inverse(), vector(accuracy.rotation_sigma));
      T.translation() += vector(accuracy.position_sigma);
      truth.push_back(T);
    }
    const RelativePoseError relative = relativePoseError(run.record(), truth, 2, 39, assumed);
    const Matrix6d own = relativePoseError(run.record(), truth, 2, 39).covariance;
    const Matrix6d P = relative.covariance - own;  // without the odometry, which has no error
    sum += relative.error.dot(P.ldlt().solve(relative.error)) / 6 / kRuns;
  }
  return sum;
}

TEST(RelativePoseError, ContainsTheCovarianceOfTheGroundTruth) {
  const GroundTruthAccuracy accuracy{0.05, 0.002, 0.004};
  EXPECT_NEAR(meanNeesOfNoisyGroundTruth(accuracy, accuracy), 1, 0.1);
  EXPECT_GT(meanNeesOfNoisyGroundTruth(accuracy, {0.05, 0.002, 0}), 1.2);
  EXPECT_GT(meanNeesOfNoisyGroundTruth(accuracy, {0.05, 0.001, 0.004}), 1.2);
  EXPECT_GT(meanNeesOfNoisyGroundTruth(accuracy, {0.025, 0.002, 0.004}), 1.2);
}

TEST(CovarianceMetrics, AlsoTellsTheNeesOfAnExactGroundTruth) {
  const SimulatedRun run(1, 130, 2);
  const auto exact = computeCovarianceMetrics(run.record(), run.truth()).by_length.front();
  const auto measured =
      computeCovarianceMetrics(run.record(), run.truth(), kGpsImuAccuracy).by_length.front();
  EXPECT_EQ(exact.nees_per_dof, exact.nees_per_dof_exact_ground_truth);
  EXPECT_EQ(measured.nees_per_dof_exact_ground_truth, exact.nees_per_dof);
  EXPECT_LT(measured.nees_per_dof, exact.nees_per_dof);
}

TEST(CovarianceMetrics, TheGroundTruthOfKittiHasItsPublishedAccuracy) {
  EXPECT_EQ(kGpsImuAccuracy.position_sigma, 0.05);
  EXPECT_NEAR(kGpsImuAccuracy.rotation_sigma * 180 / M_PI, 0.1, 1e-12);
  EXPECT_EQ(kGpsImuAccuracy.alignment_sigma, 0.004);
}

}  // namespace
}  // namespace ground_scale_vo
