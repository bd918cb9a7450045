#include "scale/metric_trajectory.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>

namespace gsv {
namespace {

/// Frame i of a camera at 10 Hz.
VoFrame frameAt(int i, const Eigen::Isometry3d& T_w_c,
                Continuity continuity = Continuity::kSameMap) {
  VoFrame frame;
  frame.stamp_ns = 100000000ll * i;
  frame.sequence = static_cast<std::uint32_t>(i);
  frame.status = VoStatus::kTracking;
  frame.continuity = continuity;
  frame.T_w_c = T_w_c;
  return frame;
}

/// Of a camera at a height of 1 m.
ScaleEstimate scaleOf(double scale, double relative_sigma = 0) {
  ScaleEstimate estimate;
  estimate.status = ScaleStatus::kOk;
  estimate.scale = scale;
  estimate.sigma = scale * relative_sigma;
  estimate.height = 1 / scale;
  return estimate;
}

Eigen::Isometry3d straight(double z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().z() = z;
  return T;
}

/// With the continuity of the frames.
class Trajectory : public MetricTrajectory {
 public:
  explicit Trajectory(const Options& options = {}) : MetricTrajectory(options) {}
  std::optional<MetricPose> append(const VoFrame& frame, const ScaleEstimate& scale) {
    return MetricTrajectory::append(frame, frame.continuity, scale);
  }
  /// Of a camera that moves along its optical axis, at z [VO units].
  std::optional<MetricPose> append(int i, double z, const ScaleEstimate& scale,
                                   Continuity continuity = Continuity::kSameMap) {
    return append(frameAt(i, straight(z), continuity), scale);
  }
  void appendInitialising(int i, Continuity continuity = Continuity::kSameMap) {
    VoFrame frame = frameAt(i, straight(0), continuity);
    frame.status = VoStatus::kInitialising;
    append(frame, {});
  }
};

double sigmaAlongZ(const MetricPose& pose) { return std::sqrt(pose.covariance(2, 2)); }

/// Pose of frame i: in each frame 0.5 VO units ahead and a yaw of 0.02 rad.
Eigen::Isometry3d onCircle(int i) {
  Eigen::Isometry3d step(Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY()));
  step.translation().z() = 0.5;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (int k = 0; k < i; ++k) T = T * step;
  return T;
}

TEST(MetricTrajectory, ANewScaleAppliesToAllMotionOfAYoungMap) {
  MetricTrajectory::Options options;
  options.young_map_heights = 10;
  Trajectory trajectory(options);
  EXPECT_FALSE(trajectory.append(0, 0, {}));
  EXPECT_FALSE(trajectory.append(1, 0.5, {}));
  auto pose = trajectory.append(2, 1, scaleOf(2, 0.1));  // includes the motion before
  EXPECT_DOUBLE_EQ(pose->T_o_c.translation().z(), 2);
  EXPECT_DOUBLE_EQ(pose->distance, 2);
  EXPECT_NEAR(pose->twist_c(2), 10, 1e-9);  // of the last increment
  EXPECT_NEAR(std::sqrt(pose->twist_covariance(2, 2)), 1, 0.02);
  pose = trajectory.append(3, 2, scaleOf(3, 0.05));
  EXPECT_DOUBLE_EQ(pose->T_o_c.translation().z(), 6);
  EXPECT_DOUBLE_EQ(pose->distance, 6);
  EXPECT_NEAR(sigmaAlongZ(*pose), 6 * 0.05, 1e-9);
  EXPECT_NEAR(pose->twist_c(2), 30, 1e-9);
  // 12 camera heights: from the next frame on the past is fixed.
  EXPECT_DOUBLE_EQ(trajectory.append(4, 4, scaleOf(3, 0.05))->T_o_c.translation().z(), 12);
  pose = trajectory.append(5, 5, scaleOf(2, 0.05));
  EXPECT_DOUBLE_EQ(pose->T_o_c.translation().z(), 14);
  EXPECT_GT(sigmaAlongZ(*pose), 12 * 0.05);
}

// Without MapStart the world frame of a map is known only if its initialisation was seen.
TEST(MetricTrajectory, AMapCountsFromItsFirstFrameWhenThatWasSeen) {
  const struct Case {
    Continuity continuity;
    std::int64_t start_ns;
    bool counts;
  } kCases[] = {{Continuity::kSameMap, 0, true},  // not known
                {Continuity::kNewMap, 0, false},
                {Continuity::kSameMap, 400'000'000, true},
                {Continuity::kNewMap, 400'000'000, true},
                {Continuity::kSameMap, 800'000'000, false},  // in the future
                {Continuity::kSameMap, 1, false}};           // before a reset
  for (const Case& each : kCases) {
    SCOPED_TRACE(each.start_ns);
    Trajectory trajectory;
    trajectory.appendInitialising(3);
    VoFrame frame = frameAt(7, straight(3), each.continuity);
    frame.map_start.stamp_ns = each.start_ns;
    EXPECT_EQ(trajectory.countsFromStart(frame), each.counts);
    const auto pose = trajectory.append(frame, scaleOf(2));
    EXPECT_DOUBLE_EQ(pose->T_o_c.translation().z(), each.counts ? 6 : 0);
    EXPECT_DOUBLE_EQ(pose->distance, each.counts ? 6 : 0);
    if (each.start_ns != 400'000'000) continue;
    EXPECT_NEAR(pose->twist_c(2), 20, 1e-9);  // 6 m in 0.3 s
  }
}

// The motion since the map's first frame is part of the trajectory already.
TEST(MetricTrajectory, AMapThatStartsInItsMiddleCountsFromThatFrame) {
  for (const bool has_scale : {true, false}) {
    Trajectory trajectory;
    std::optional<MetricPose> pose;
    for (int i = 1; i <= 22; ++i) {
      VoFrame frame = frameAt(i, straight(i < 21 ? i - 1 : 1000 + i));
      frame.map_start.stamp_ns = frameAt(1, {}).stamp_ns;
      pose = trajectory.MetricTrajectory::append(
          frame, i == 21 ? Continuity::kNewMap : Continuity::kSameMap,
          i == 21 && !has_scale ? ScaleEstimate() : scaleOf(1));
      if (i != 21 || !has_scale) continue;
      EXPECT_NEAR(pose->T_o_c.translation().z(), 20, 1e-9);  // the last metre bridges the gap
      EXPECT_NEAR(pose->distance, 20, 1e-9);
    }
    EXPECT_NEAR(pose->T_o_c.translation().z(), 21, 1e-9);
    EXPECT_NEAR(pose->distance, 21, 1e-9);
  }
}

TEST(MetricTrajectory, AStandstillAddsNothingAndItsTwistIsNotExact) {
  Trajectory trajectory;
  const auto first = trajectory.append(1, 1, scaleOf(2, 0.05));
  EXPECT_EQ(first->T_o_c.translation().norm(), 0);
  EXPECT_EQ(first->distance, 0);
  EXPECT_EQ(first->covariance.norm(), 0);
  EXPECT_EQ(first->twist_c.norm(), 0);
  EXPECT_GT(std::sqrt(first->twist_covariance.diagonal().minCoeff()), 10);  // not known
  const auto standstill = trajectory.append(2, 1, scaleOf(2, 0.05));
  EXPECT_EQ(standstill->covariance, first->covariance);
  EXPECT_EQ(standstill->twist_c.norm(), 0);
  // A pose error of some millimetres in 0.1 s.
  EXPECT_GT(std::sqrt(standstill->twist_covariance.diagonal().head<3>().minCoeff()), 0.01);
  EXPECT_GT(std::sqrt(standstill->twist_covariance.diagonal().tail<3>().minCoeff()), 1e-3);
}

TEST(MetricTrajectory, SkipsIncrementsThatAreNotFinite) {
  Trajectory trajectory;
  ASSERT_TRUE(trajectory.append(0, 1, scaleOf(2, 0.01)));
  for (const double number : {std::nan(""), HUGE_VAL, 1e300}) {
    EXPECT_FALSE(trajectory.append(1, number, scaleOf(2, 0.01))) << number;
    EXPECT_FALSE(trajectory.append(1, 1.5, scaleOf(2, number))) << number;
  }
  const auto pose = trajectory.append(2, 2, scaleOf(2, 0.01));
  ASSERT_TRUE(pose);
  EXPECT_DOUBLE_EQ(pose->T_o_c.translation().z(), 2);  // from the first frame seen
  EXPECT_TRUE(pose->covariance.allFinite());
}

/// Without errors except those that a test adds.
MetricTrajectory::Options exact() {
  MetricTrajectory::Options options;
  options.rotation_sigma_per_sqrt_m = options.direction_sigma = options.rotation_scale_sigma = 0;
  return options;
}

// An error that is common to all of the drive, of which the first half has a sigma of 2 % and the
// second one of 4 %.
TEST(MetricTrajectory, ACorrelatedScaleErrorGrowsWithItsSigma) {
  MetricTrajectory::Options options = exact();
  options.young_map_heights = 0;
  options.scale_correlation_m = 1e6;
  Trajectory trajectory(options);
  std::optional<MetricPose> pose;
  for (int i = 0; i <= 100; ++i) {
    pose = trajectory.append(i, i, scaleOf(2, i < 50 ? 0.02 : 0.04));
  }
  EXPECT_NEAR(sigmaAlongZ(*pose), 0.02 * 100 + 0.04 * 100, 0.06);
  EXPECT_EQ(pose->covariance, pose->covariance.transpose());
}

/// About the one of 200 points at a depth of 10, whose pixels have an error of 1 px at 500 px.
VoFrame withCovariance(VoFrame frame) {
  Eigen::Matrix<double, 6, 6> root = Eigen::Matrix<double, 6, 6>::Identity();
  root.diagonal() << 4e-3, 4e-3, 1e-3, 4e-4, 4e-4, 2e-4;
  root(4, 0) = 3e-4;
  root(3, 1) = -3e-4;
  frame.pose_covariance = root * root.transpose();
  return frame;
}

/// A scale of 2 with a relative sigma of 0.01, all of it the camera height's.
ScaleEstimate scaleByHeight() {
  ScaleEstimate scale = scaleOf(2, 0.01);
  scale.camera_height = 1.5;
  scale.camera_height_sigma = 0.015;
  return scale;
}

// Errors of the length do not cancel on a loop, as those of the position do: the camera height's is
// the same factor of every metre, the filter's is independent after scale_correlation_m.
TEST(MetricTrajectory, TheErrorOfTheDistanceIsSummedAlongALoop) {
  MetricTrajectory::Options options;
  options.scale_correlation_m = 10;
  for (const ScaleEstimate& scale : {scaleByHeight(), scaleOf(2, 0.01)}) {
    Trajectory trajectory(options);
    std::optional<MetricPose> pose;
    for (int i = 0; i <= 314; ++i) pose = trajectory.append(frameAt(i, onCircle(i)), scale);
    EXPECT_NEAR(pose->T_o_c.translation().norm(), 0, 1);
    EXPECT_NEAR(pose->distance, 314, 0.1);
    const double sigma = scale.camera_height > 0 ? 0.01 * 314 : 0.01 * std::sqrt(2 * 314 * 10);
    EXPECT_NEAR(pose->distance_sigma, sigma, 0.05 * sigma);
  }
}

// A constant factor: it grows with the distance from the start, also over a gap between two maps,
// and comes back with the vehicle.
TEST(MetricTrajectory, TheErrorOfTheCameraHeightIsAFactorOfTheWholeDrive) {
  MetricTrajectory::Options options;
  options.direction_sigma = options.rotation_sigma_per_sqrt_m = 0;
  Trajectory trajectory(options);
  std::optional<MetricPose> pose;
  const auto drive = [&](int from, int to, double z, double step, bool is_new_map) {
    for (int i = from; i < to; ++i) {
      pose =
          trajectory.append(i, z + step * (i - from), scaleByHeight(),
                            is_new_map && i == from ? Continuity::kNewMap : Continuity::kSameMap);
    }
    return sigmaAlongZ(*pose) / pose->T_o_c.translation().z();
  };
  EXPECT_NEAR(drive(0, 101, 0, 0.5, false), 0.01, 1e-4);
  EXPECT_NEAR(drive(101, 201, 0, 0.5, true), 0.01, 0.003);  // and the acceleration in the gap
  const double far = sigmaAlongZ(*pose);
  drive(201, 300, 49, -0.4, false);
  EXPECT_LT(sigmaAlongZ(*pose), 0.75 * far);
}

// A rotation and a translation between the map's first frame and its first metric one.
TEST(MetricTrajectory, TheFirstMotionAndItsErrorsAreInTheAxesOfTheFirstImage) {
  MetricTrajectory::Options options = exact();
  options.rotation_scale_sigma = 0.1;
  Trajectory trajectory(options);
  trajectory.appendInitialising(0);
  const Eigen::Matrix3d R_o_ref =
      Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX()).toRotationMatrix();
  const Eigen::Isometry3d T_ref_c = straight(2) * Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY());
  VoFrame frame = withCovariance(frameAt(7, T_ref_c));
  frame.map_start = {frameAt(4, {}).stamp_ns, R_o_ref, 0.01};
  const auto pose = trajectory.append(frame, scaleOf(1));
  const Eigen::Vector3d step_o = R_o_ref * Eigen::Vector3d(0, 0, 2);
  EXPECT_NEAR((pose->T_o_c.translation() - step_o).norm(), 0, 1e-9);
  EXPECT_NEAR((pose->T_o_c.linear() - R_o_ref * T_ref_c.linear()).norm(), 0, 1e-9);
  Matrix6d R = Matrix6d::Zero();
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = R_o_ref * T_ref_c.linear();
  Matrix6d expected = R * frame.pose_covariance * R.transpose();
  // The error of R_o_ref turns the step.
  Eigen::Matrix<double, 6, 3> G;
  G << -skew(step_o), Eigen::Matrix3d::Identity();
  expected += 0.01 * 0.01 * G * G.transpose();
  const Eigen::Vector3d turn_o = R_o_ref * Eigen::Vector3d(0, 0.5, 0);
  expected.bottomRightCorner<3, 3>() += 0.01 * turn_o * turn_o.transpose();
  EXPECT_NEAR((pose->covariance - expected).norm(), 0, 1e-12);
}

// A spatial curve: in each frame the camera moves by kStep [m] and turns [rad], both in its own
// axes.
const Eigen::Vector3d kStep(0.3, -0.2, 1);
Eigen::Matrix3d turnBy(double factor, int i) {
  const Eigen::Vector3d turn =
      i % 20 < 10 ? Eigen::Vector3d(0.02, 0.05, -0.03) : Eigen::Vector3d(-0.06, 0, 0.04);
  return exponentialMap(factor * turn, {0, 0, 0}).linear();
}

class TrajectoryCovariance : public testing::TestWithParam<double> {};

// Monte Carlo simulation of the error model. The parameter is young_map_heights.
TEST_P(TrajectoryCovariance, FitsSimulatedErrors) {
  constexpr int kSteps = 40, kRuns = 4000;
  constexpr double kScale = 2, kScaleSigma = 0.02;
  MetricTrajectory::Options options;
  options.young_map_heights = GetParam();
  options.rotation_sigma_per_sqrt_m = 0.001;
  options.rotation_scale_sigma = 0.03;
  options.direction_sigma = 0.03;
  Trajectory trajectory(options);
  std::optional<MetricPose> pose;
  // The axes of the map differ from the axes of the first camera.
  Eigen::Isometry3d T = Eigen::Isometry3d(Eigen::AngleAxisd(1, Eigen::Vector3d(1, 2, 2) / 3));
  for (int i = 0; i <= kSteps; ++i) {
    pose = trajectory.append(withCovariance(frameAt(i, T)), scaleOf(kScale, kScaleSigma));
    T.translate(kStep / kScale).rotate(turnBy(1, i));
  }
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto noise = [&] { return normal(random); };
  const auto noise3 = [&] { return Eigen::Vector3d(noise(), noise(), noise()); };
  const double length = kStep.norm(), share = std::exp(-length / options.scale_correlation_m);
  const auto drift = [&](double* error, double sigma) {
    *error = share * *error + std::sqrt(1 - share * share) * sigma * noise();
  };
  const Matrix6d pose_root =
      withScaledPosition(withCovariance({}).pose_covariance, kScale).llt().matrixL();
  Matrix6d sample = Matrix6d::Zero();
  for (int run = 0; run < kRuns; ++run) {
    Eigen::Isometry3d exact = Eigen::Isometry3d::Identity(), estimate = exact;
    double scale_error = kScaleSigma * noise(), turn_error = options.rotation_scale_sigma * noise();
    for (int i = 0; i < kSteps; ++i) {
      const Eigen::Vector3d across = kStep.cross(noise3()) * options.direction_sigma;
      estimate.translate((1 + scale_error) * kStep + across).rotate(turnBy(1 + turn_error, i));
      exact.translate(kStep).rotate(turnBy(1, i));
      const Vector6d walk =
          std::sqrt(length / 2) * pose_root * (Vector6d() << noise3(), noise3()).finished();
      estimate.translation() += exact.linear() * walk.head<3>();
      const Eigen::Vector3d turned =
          exact.linear() * walk.tail<3>() +
          options.rotation_sigma_per_sqrt_m * std::sqrt(length) * noise3();
      estimate.linear() = exponentialMap(turned, {0, 0, 0}).linear() * estimate.linear();
      // The camera height is 1 m.
      if (length * (i + 1) >= options.young_map_heights) drift(&scale_error, kScaleSigma);
      drift(&turn_error, options.rotation_scale_sigma);
    }
    Vector6d error;  // position, then rotation as a left perturbation, in o axes
    error << estimate.translation() - exact.translation(),
        rotationVector(estimate.linear() * exact.linear().transpose());
    sample += error * error.transpose() / kRuns;
  }
  // The sample relative to the covariance: the identity, up to 1 / sqrt(kRuns) in each element.
  const Eigen::LLT<Matrix6d> root(pose->covariance);
  ASSERT_EQ(root.info(), Eigen::Success);
  const Matrix6d half = root.matrixL().solve(sample);
  const Matrix6d relative = root.matrixL().solve(Matrix6d(half.transpose()));
  EXPECT_LT((relative - Matrix6d::Identity()).cwiseAbs().maxCoeff(), 0.12) << relative;
}

INSTANTIATE_TEST_SUITE_P(YoungMap, TrajectoryCovariance, testing::Values(0, 20, 1000));

/// Pose with the twist over 0.1 s, in a curve with errors of one kind and white noise.
MetricPose poseWith(double MetricTrajectory::Options::*error, double value,
                    double relative_scale_sigma = 0, bool has_covariance = false) {
  MetricTrajectory::Options options = exact();
  if (error != nullptr) options.*error = value;
  Trajectory trajectory(options);
  const auto frame = [&](int i) {
    return has_covariance ? withCovariance(frameAt(i, onCircle(i))) : frameAt(i, onCircle(i));
  };
  trajectory.append(frame(0), scaleOf(2));
  return *trajectory.append(frame(1), scaleOf(2, relative_scale_sigma));
}

TEST(MetricTrajectory, TheTwistIsInCameraAxesAndContainsEachError) {
  using Options = MetricTrajectory::Options;
  const MetricPose without = poseWith(nullptr, 0);
  const Matrix6d& white = without.twist_covariance;
  EXPECT_NEAR(white(0, 0), 2 * std::pow(0.002 / 0.1, 2), 1e-9);  // of two positions
  EXPECT_NEAR(white(3, 3), 2 * std::pow(0.00015 / 0.1, 2), 1e-9);
  const auto expectCovariance = [&](const MetricPose& actual, const Eigen::Matrix3d& linear,
                                    const Eigen::Matrix3d& angular) {
    Matrix6d expected = white;
    expected.topLeftCorner<3, 3>() += linear;
    expected.bottomRightCorner<3, 3>() += angular;
    EXPECT_NEAR((actual.twist_covariance - expected).norm(), 0, 1e-9);
  };
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity(), zero = Eigen::Matrix3d::Zero();
  // 1 m in 0.1 s along the previous z axis, while the camera turned by 0.02 rad: on an arc from
  // that axis the camera would move to its right.
  const Eigen::Vector3d v(-0.1, 0, 0.1 / std::tan(0.01)), w(0, 0.2, 0);
  EXPECT_NEAR((without.twist_c - (Vector6d() << v, w).finished()).norm(), 0, 1e-9);
  const Eigen::Matrix3d along = v * v.transpose();
  expectCovariance(poseWith(nullptr, 0, 0.05), 0.0025 * along, zero);
  expectCovariance(poseWith(&Options::direction_sigma, 0.02),
                   0.0004 * (v.squaredNorm() * I - along), zero);
  expectCovariance(poseWith(&Options::rotation_scale_sigma, 0.1), zero, 0.01 * w * w.transpose());
  // Over 1 m and 0.1 s. The walk is the sum of errors that are correlated over 10 m; the errors of
  // two poses that are 1 m apart differ by half the covariance of one.
  const double length = 0.1 * v.norm();
  expectCovariance(poseWith(&Options::rotation_sigma_per_sqrt_m, 0.001), zero,
                   1e-6 * length * (length / 20) / 0.01 * I);
  const Matrix6d poses =
      white +
      length / 2 * withScaledPosition(withCovariance(frameAt(0, {})).pose_covariance, 2) / 0.01;
  EXPECT_GT(std::sqrt(poses(4, 4)), 1e-3);
  const Matrix6d with_poses = poseWith(nullptr, 0, 0, true).twist_covariance;
  EXPECT_NEAR((with_poses - poses).norm(), 0, 1e-6 * poses.norm());
}

TEST(MetricTrajectory, TheTwistOnAnArcHasNoLateralSlip) {
  for (const double angle : {0.0, 1e-5, 0.05, 1.0, 3.0}) {
    SCOPED_TRACE(angle);
    Trajectory trajectory;
    trajectory.append(frameAt(0, Eigen::Isometry3d::Identity()), scaleOf(2));
    const Eigen::Vector3d w(0, angle, 0), v(0, 0, 0.5);
    const auto pose = trajectory.append(frameAt(1, exponentialMap(w, v)), scaleOf(2));
    EXPECT_NEAR((pose->twist_c.head<3>() - Eigen::Vector3d(0, 0, 10)).norm(), 0, 1e-9);
    EXPECT_NEAR((pose->twist_c.tail<3>() - w / 0.1).norm(), 0, 1e-9);
  }
}

/// 10 m/s for 1 s in map 0, up to frame 10; the pose of frame 10.
MetricPose drive(Trajectory* trajectory) {
  std::optional<MetricPose> pose;
  for (int i = 0; i <= 10; ++i) pose = trajectory->append(i, 0.5 * i, scaleOf(2, 0.02));
  return *pose;
}

// It counts from its first tracked frame, because its start is not known.
TEST(MetricTrajectory, ALaterMapContinuesWithAnIndependentScaleError) {
  Trajectory trajectory(exact());
  const MetricPose last = drive(&trajectory);
  trajectory.appendInitialising(11, Continuity::kNewMap);
  const auto first = trajectory.append(12, 30, scaleOf(2));
  EXPECT_NEAR(first->T_o_c.translation().z() - last.T_o_c.translation().z(), 2, 1e-9);
  EXPECT_NEAR(first->distance - last.distance, 2, 1e-9);  // 0.2 s at 10 m/s
  const auto later = trajectory.append(13, 35, scaleOf(2));
  EXPECT_NEAR(later->covariance(2, 2), first->covariance(2, 2), 1e-12);
}

// A yaw error of 0.1 rad from one gap turns the next gap of 10 m, too.
TEST(MetricTrajectory, ASecondGapIsTurnedByTheRotationErrorOfTheFirst) {
  MetricTrajectory::Options options = exact();
  options.bridge_acceleration_sigma = 0;
  Trajectory trajectory(options);
  std::optional<MetricPose> pose;
  for (const int start : {0, 20, 40}) {
    VoFrame frame = frameAt(start, straight(0), Continuity::kNewMap);
    frame.map_start = {frame.stamp_ns, Eigen::Matrix3d::Identity(), start == 20 ? 0.1 : 0};
    pose = trajectory.append(frame, scaleOf(1));
    if (start < 40) trajectory.append(start + 10, 10, scaleOf(1));
  }
  ASSERT_TRUE(pose);
  // 5 m for half of the error, then 10 m of the map and the second gap of 10 m.
  EXPECT_NEAR(pose->T_o_c.translation().z(), 40, 1e-9);
  EXPECT_NEAR(pose->covariance(0, 4), 0.01 * (5 + 20), 1e-9);
  EXPECT_NEAR(pose->covariance(1, 3), -0.01 * (5 + 20), 1e-9);
  EXPECT_NEAR(pose->covariance(0, 0), 0.01 * 25 * 25, 1e-3);
}

/// Variance along the path after 1 m at 10 m/s, a gap, and 1 m in a later map, for which a velocity
/// of 10 m/s is known or not [m^2]. The sigmas belong to the two maps' scales.
double varianceAfterGap(double acceleration_sigma, double gap_s, bool has_velocity_after,
                        double relative_sigma_before, double relative_sigma_after) {
  MetricTrajectory::Options options = exact();
  options.bridge_acceleration_sigma = acceleration_sigma;
  Trajectory trajectory(options);
  trajectory.append(0, 0, scaleOf(2, relative_sigma_before));
  trajectory.append(1, 0.5, scaleOf(2, relative_sigma_before));
  const int start = 1 + static_cast<int>(10 * gap_s);
  VoFrame frame = frameAt(has_velocity_after ? start + 1 : start, straight(1), Continuity::kNewMap);
  frame.map_start = {frameAt(start, {}).stamp_ns, Eigen::Matrix3d::Identity(), 0};
  return trajectory.append(frame, scaleOf(1, relative_sigma_after))->covariance(2, 2);
}

// An acceleration a over a gap of t: with one known velocity the position is wrong by a t^2 / 2,
// with both by at most half of that. Scales that are wrong by 10 % and 20 %: the motion in the maps
// by 0.1 m and 0.2 m, the velocities by 1 m/s and 2 m/s. The gap has the first velocity, or the
// mean of both.
TEST(MetricTrajectory, TheSigmaOfAGapContainsAccelerationAndErrorsOfTheScales) {
  for (const double gap_s : {1.0, 2.0}) {
    for (const bool has_velocity_after : {false, true}) {
      EXPECT_NEAR(std::sqrt(varianceAfterGap(3, gap_s, has_velocity_after, 0, 0)),
                  3 * gap_s * gap_s / (has_velocity_after ? 4 : 2), 0.01);
      const double in_maps = 0.1 * 0.1 + 0.2 * 0.2;
      const double velocity_variance = has_velocity_after ? 0.25 * (1 + 4) : 1;
      EXPECT_NEAR(varianceAfterGap(0, gap_s, has_velocity_after, 0.1, 0.2),
                  in_maps + velocity_variance * gap_s * gap_s, 0.02);
    }
  }
}

// A turn of 90 degrees in the gap of 1 s, during which the speed v changes linearly: at the time t
// the velocity is v(t) (sin w t, 0, cos w t), with w = pi / 2 per second.
TEST(MetricTrajectory, AGapWithAKnownRotationIsAnArc) {
  for (const double speed_after : {5.0, 10.0, 20.0}) {  // 10 m/s before
    Trajectory trajectory;
    const MetricPose last = drive(&trajectory);
    VoFrame frame = frameAt(22, straight(0.02 * speed_after), Continuity::kNewMap);
    frame.map_start = {frameAt(20, {}).stamp_ns,
                       Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()).matrix(), 0.01};
    const auto pose = trajectory.append(frame, scaleOf(10, 0.02));
    const double w = M_PI / 2, change = speed_after - 10;
    const Eigen::Vector3d arc(10 / w + change / (w * w), 0, speed_after / w - change / (w * w));
    const Eigen::Vector3d after_gap(0.2 * speed_after, 0, 0);
    const Eigen::Vector3d expected = last.T_o_c.translation() + arc + after_gap;
    EXPECT_NEAR((pose->T_o_c.translation() - expected).norm(), 0, 0.02) << speed_after;
    EXPECT_NEAR((pose->T_o_c.linear() - frame.map_start.R_previous_w).norm(), 0, 1e-9);
    EXPECT_NEAR(std::sqrt(pose->covariance(4, 4)), 0.01, 0.002);
  }
}

// At 9 m/s, the second image of each pair is stamped 1 ms after the first: 900 m/s in the twist.
TEST(MetricTrajectory, AGapAfterImagesInPairsIsBridgedWithTheirMeanVelocity) {
  for (const int count : {20, 21}) {  // the last one is the second of a pair, or the first
    Trajectory trajectory;
    MetricPose last;
    VoFrame frame;
    for (int i = 0; i < count; ++i) {
      frame = frameAt(2 * (i / 2), straight(0.45 * i));
      frame.stamp_ns += i % 2 * 1000000;
      last = *trajectory.append(frame, scaleOf(2, 0.02));
    }
    VoFrame next = frameAt(0, straight(0), Continuity::kNewMap);
    next.stamp_ns = frame.stamp_ns + 3000000000;
    const auto pose = trajectory.append(next, scaleOf(2, 0.02));
    const double gap = pose->T_o_c.translation().z() - last.T_o_c.translation().z();
    EXPECT_NEAR(gap, 27, 0.3) << count;
    EXPECT_GT(sigmaAlongZ(*pose), 5);  // an acceleration of 2 m/s^2 for 3 s
    EXPECT_LT(sigmaAlongZ(*pose), 15);
  }
}

// Two intervals of 0.2 s and 0.05 s at a constant 10 m/s along the first camera's z axis. In the
// second one the camera turns to the right by 90 degrees, so its motion is along its -x axis.
TEST(MetricTrajectory, TheMeanVelocityOfAGapIsInTheAxesOfTheCameraBeforeIt) {
  Trajectory trajectory;
  trajectory.append(0, 0, scaleOf(2));
  trajectory.append(2, 1, scaleOf(2));
  VoFrame frame =
      frameAt(2, straight(1.25) * Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()));
  frame.stamp_ns += 50000000;
  const auto last = trajectory.append(frame, scaleOf(2));
  VoFrame next = frameAt(0, straight(0), Continuity::kNewMap);
  next.stamp_ns = frame.stamp_ns + 1000000000;
  const auto pose = trajectory.append(next, scaleOf(2));
  const Eigen::Vector3d gap_o = pose->T_o_c.translation() - last->T_o_c.translation();
  EXPECT_NEAR((gap_o - Eigen::Vector3d(0, 0, 10)).norm(), 0, 1e-6) << gap_o.transpose();
}

// The axes of a map without a scale do not matter, only the rotation in it. It is 1 s to that map,
// then 2 s to the next one; the rotation rate has a standard deviation of 0.1 rad/s.
TEST(MetricTrajectory, UnknownRotationsBetweenMapsInOtherAxesAddUp) {
  Trajectory trajectory(exact());
  drive(&trajectory);
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY()).matrix();
  const Eigen::Isometry3d axes(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX()));
  VoFrame frame = frameAt(20, axes, Continuity::kNewMap);
  EXPECT_FALSE(trajectory.append(frame, {}).has_value());
  frame = frameAt(21, axes);
  frame.T_w_c.rotate(turn);
  EXPECT_FALSE(trajectory.append(frame, {}).has_value());
  const auto pose = trajectory.append(41, 0, scaleOf(2), Continuity::kNewMap);
  EXPECT_NEAR((pose->T_o_c.linear() - turn).norm(), 0, 1e-9);
  EXPECT_NEAR(pose->covariance(4, 4), 0.1 * 0.1 + 0.2 * 0.2, 1e-9);
}

// A camera that repeats one image looks like a standstill until the next new image.
TEST(MetricTrajectory, AStandstillThatEndsInANewMapCountsAsUnobserved) {
  Trajectory trajectory(exact());
  trajectory.append(0, 0, scaleOf(2, 0.02));
  const auto last = trajectory.append(1, 1, scaleOf(2, 0.02));
  ScaleEstimate standstill = scaleOf(2, 0.02);
  standstill.status = ScaleStatus::kHeld;
  standstill.measurement = MeasurementStatus::kStandstill;
  for (int i = 2; i <= 21; ++i) trajectory.append(i, 1, standstill);
  const auto first = trajectory.append(31, 0.7, scaleOf(9, 0.02), Continuity::kNewMap);
  // 5 m/s and 0.1 rad/s for the 3 s since the last motion
  EXPECT_NEAR(first->covariance(0, 0) - last->covariance(0, 0), 15 * 15, 1e-9);
  EXPECT_NEAR(first->covariance(4, 4) - last->covariance(4, 4), 0.3 * 0.3, 1e-9);
  EXPECT_EQ(first->T_o_c.translation(), last->T_o_c.translation());
}

}  // namespace
}  // namespace gsv
