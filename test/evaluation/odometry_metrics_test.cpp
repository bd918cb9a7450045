#include "ground_scale_vo/evaluation/metrics.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;

/// n poses, each `step` metres ahead of the previous and turned by `yaw` after the step.
Poses drive(std::size_t n, double step, double yaw = 0.0) {
  Eigen::Isometry3d increment = Eigen::Isometry3d::Identity();
  increment.translation().z() = step;
  increment.rotate(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()));
  Poses poses{Eigen::Isometry3d::Identity()};
  while (poses.size() < n) poses.push_back(poses.back() * increment);
  return poses;
}

Poses scaled(Poses poses, double scale) {
  for (auto& pose : poses) pose.translation() *= scale;
  return poses;
}

// 2 % too long on a straight line of 1 m steps. A segment of length L ends at the first frame that
// is farther than L, so it is L + 1 m long and its error is 0.02 (L + 1) / L.
TEST(OdometryMetrics, ScaleErrorOnAStraightLine) {
  const Poses ground_truth = drive(252, 1.0);  // 251 m
  const OdometryMetrics m = computeOdometryMetrics(ground_truth, scaled(ground_truth, 1.02));
  EXPECT_NEAR(m.gt_length_m, 251.0, 1e-9);
  EXPECT_NEAR(m.length_m, 256.02, 1e-9);
  EXPECT_NEAR(m.rle_percent.value(), 2.0, 1e-9);

  // Segments of 100 m from the starts 0, 10 ... 150, which ends in frame 251, and six of 200 m.
  EXPECT_NEAR(m.t_err_percent.value(), (16 * 2.02 + 6 * 2.01) / 22, 1e-9);
  EXPECT_NEAR(m.r_err_deg_per_m.value(), 0.0, 1e-10);

  double sum = 0, segments = 0;
  for (int length = 10; length <= 80; length += 10) {
    const int starts = (251 - length - 1) / 10 + 1;
    sum += starts * 2.0 * (length + 1) / length;
    segments += starts;
  }
  EXPECT_NEAR(m.t_err_short_percent.value(), sum / segments, 1e-9);

  // Without the error of the scale nothing is left.
  EXPECT_NEAR(m.t_err_true_length_percent.value(), 0.0, 1e-9);
  EXPECT_NEAR(m.t_err_sim3_percent.value(), 0.0, 1e-9);

  // Residuals 0.02 (i - 125.5) of 252 evenly spaced points: standard deviation of 0 ... 251.
  EXPECT_NEAR(m.ate_rmse_m, 0.02 * std::sqrt((252.0 * 252.0 - 1.0) / 12.0), 1e-9);
}

// A constant yaw bias in every step of 1 m: after L + 1 steps the rotation is off by L + 1 times
// it.
TEST(OdometryMetrics, YawRateBias) {
  const double bias_deg = 0.01;
  const Poses ground_truth = drive(121, 1.0);
  const OdometryMetrics m =
      computeOdometryMetrics(ground_truth, drive(121, 1.0, bias_deg * M_PI / 180.0));
  EXPECT_NEAR(m.r_err_deg_per_m.value(), bias_deg * 101 / 100, 1e-9);
  // The estimate is a regular polygon with sides of 1 m. Its end point after 101 sides is compared
  // with that of a straight line.
  const double b = bias_deg * M_PI / 180.0;
  Eigen::Vector2d end = Eigen::Vector2d::Zero();
  for (int i = 0; i < 101; ++i) end += Eigen::Vector2d(std::sin(i * b), std::cos(i * b));
  // The error is expressed in the estimate's end frame, but its norm is that of the difference. In
  // metres over 100 m, it is a percentage.
  EXPECT_NEAR(m.t_err_percent.value(), (end - Eigen::Vector2d(0, 101)).norm(), 1e-9);
  EXPECT_NEAR(m.rle_percent.value(), 0.0, 1e-9);
}

TEST(OdometryMetrics, ErrorOfAMisalignedCameraWithTrueLengths) {
  const Poses ground_truth = drive(300, 1.0, 0.004);
  const Eigen::AngleAxisd misalignment(0.5 * M_PI / 180.0, Eigen::Vector3d::UnitX());
  Poses estimate{Eigen::Isometry3d::Identity()};
  for (std::size_t i = 1; i < ground_truth.size(); ++i) {
    Eigen::Isometry3d step = ground_truth[i - 1].inverse() * ground_truth[i];
    step.translation() = misalignment * step.translation();
    estimate.push_back(estimate.back() * step);
  }
  const OdometryMetrics m = computeOdometryMetrics(ground_truth, scaled(estimate, 0.1));
  EXPECT_NEAR(m.r_err_deg_per_m.value(), 0.0, 1e-9);
  // With true lengths, a step ends off by the chord of half a degree, 2 sin(0.25 deg) times its
  // length. Over a straight segment these errors add up, in a bend they cancel in part. A segment
  // is up to 1 % longer than its nominal length.
  const double straight_percent = 100.0 * 2.0 * std::sin(0.25 * M_PI / 180.0);
  EXPECT_GT(m.t_err_true_length_percent.value(), 0.8 * straight_percent);
  EXPECT_LT(m.t_err_true_length_percent.value(), 1.02 * straight_percent);
}

TEST(OdometryMetrics, NoDevkitErrorUnderAHundredMetres) {
  const Poses ground_truth = drive(101, 1.0);  // 100 m: no frame is farther than 100 m
  const OdometryMetrics m = computeOdometryMetrics(ground_truth, scaled(ground_truth, 1.02));
  EXPECT_FALSE(m.t_err_percent);
  EXPECT_FALSE(m.r_err_deg_per_m);
  EXPECT_FALSE(m.t_err_true_length_percent);
  EXPECT_FALSE(m.t_err_sim3_percent);
  EXPECT_TRUE(m.t_err_short_percent);
  EXPECT_NEAR(m.rle_percent.value(), 2.0, 1e-9);
}

TEST(OdometryMetrics, StandingEstimateOrGroundTruthGivesNoDivisionByZero) {
  const Poses moving = drive(150, 1.0);
  const Poses standing(150, Eigen::Isometry3d::Identity());
  const OdometryMetrics standing_estimate = computeOdometryMetrics(moving, standing);
  EXPECT_NEAR(standing_estimate.rle_percent.value(), 100.0, 1e-9);
  EXPECT_NEAR(standing_estimate.t_err_percent.value(), 101.0, 1e-9);
  EXPECT_FALSE(standing_estimate.t_err_sim3_percent);
  EXPECT_TRUE(std::isfinite(standing_estimate.ate_rmse_m));

  const OdometryMetrics standing_truth = computeOdometryMetrics(standing, moving);
  EXPECT_FALSE(standing_truth.rle_percent);
  EXPECT_FALSE(standing_truth.t_err_percent);
}

TEST(OdometryMetrics, RejectsWhatCannotBeCompared) {
  const Poses ten = drive(10, 1.0);
  EXPECT_THROW(computeOdometryMetrics(ten, drive(9, 1.0)), OptionError);
  EXPECT_THROW(computeOdometryMetrics({}, {}), OptionError);
  EXPECT_THROW(computeOdometryMetrics(drive(1, 1.0), drive(1, 1.0)), OptionError);
  for (const double value : {std::numeric_limits<double>::quiet_NaN(), 1e300}) {
    Poses broken = ten;
    broken[4].translation().x() = value;
    EXPECT_THROW(computeOdometryMetrics(ten, broken), OptionError);
    EXPECT_THROW(computeOdometryMetrics(broken, ten), OptionError);
  }
}

TEST(Quantile, IsLinearBetweenNeighbours) {
  EXPECT_DOUBLE_EQ(quantile({3, 1, 2}, 0.5), 2.0);
  EXPECT_DOUBLE_EQ(quantile({4, 1, 2, 3}, 0.5), 2.5);
  EXPECT_DOUBLE_EQ(quantile({0, 10}, 0.95), 9.5);
  EXPECT_DOUBLE_EQ(quantile({7}, 0.95), 7.0);
  EXPECT_TRUE(std::isnan(quantile({}, 0.5)));
}

}  // namespace
}  // namespace gsv
