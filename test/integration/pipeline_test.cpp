#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/metric_odometry.hpp"
#include "simulation/synthetic_drive.hpp"
#include "support/drive_run.hpp"
#include "support/temporary_folder.hpp"

// The whole pipeline on the synthetic drive and, where available, on the sequences in
// GROUND_SCALE_VO_DATA (recorded and rendered).

namespace gsv {
namespace {

// The path goes on, and nothing else of the camera before is left.
TEST(Pipeline, AnotherCameraIsAFreshStartOfTheOdometry) {
  SyntheticDrive::Options options = smallImages();
  options.frames = 30;
  const SyntheticDrive before(options);
  options.random_seed += 1;
  options.road_shift_m = 10;
  const SyntheticDrive after(options);
  CameraCalibration camera = withoutDistortion(after.camera());
  MetricOdometry odometry(camera, optionsFor(before.cameraHeight()));
  MetricOdometry fresh(camera, optionsFor(after.cameraHeight()));
  double distance = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const auto output = odometry.process(before.image(i), before.frame(i).stamp_ns);
    if (output.pose()) distance = output.pose()->distance;
  }
  ASSERT_GT(distance, 10);
  odometry.changeCamera(camera);
  const std::int64_t offset_ns = before.frame(before.size() - 1).stamp_ns + 100'000'000;
  for (std::size_t i = 0; i < after.size(); ++i) {
    const auto output = odometry.process(after.image(i), offset_ns + after.frame(i).stamp_ns);
    const auto expected = fresh.process(after.image(i), offset_ns + after.frame(i).stamp_ns);
    const VoFrame &frame = output.vo.frame, &same = expected.vo.frame;
    EXPECT_EQ(frame.sequence, before.size() + i);
    EXPECT_EQ(frame.map_id, 1u);
    ASSERT_EQ(frame.status, same.status) << i;
    EXPECT_EQ(frame.T_w_c.matrix(), same.T_w_c.matrix()) << i;
    EXPECT_EQ(frame.pose_covariance, same.pose_covariance) << i;
    ASSERT_EQ(frame.features.size(), same.features.size()) << i;
    for (std::size_t k = 0; k < frame.features.size(); ++k) {
      EXPECT_EQ(frame.features[k].id, same.features[k].id);
      EXPECT_EQ(frame.features[k].p_c, same.features[k].p_c);
    }
    EXPECT_TRUE(std::isinf(frame.map_start.rotation_sigma)) << i;
    if (output.pose()) {
      EXPECT_GE(output.pose()->distance, distance);
    }
  }
}

// Curves, a slope, pitch and roll of the suspension, a stop of five seconds, a car ahead and
// oncoming cars.
TEST(Pipeline, EstimatesTheSyntheticDriveInMetres) {
  SyntheticDrive::Options drive_options;
  drive_options.frames = 225;
  drive_options.stop_s = 5;
  drive_options.moving_cars = true;
  const SyntheticDrive drive(drive_options);
  const RunRecord record = runOffline(drive, optionsFor(1.65));
  EXPECT_EQ(record.trackedFrames(), drive.size());
  EXPECT_EQ(record.lostEvents(), 0u);
  const OdometryMetrics metrics = computeOdometryMetrics(groundTruth(drive), record.metricPoses());
  EXPECT_LT(metrics.rle_percent.value(), 2.0);
  ASSERT_TRUE(metrics.t_err_percent);
  EXPECT_LT(*metrics.t_err_percent, 2.0);
  EXPECT_LT(metrics.ate_rmse_m, 1.0);

  std::size_t standing = 0, within_2_sigma = 0, measured = 0;  // [frames]
  Eigen::Vector3d stop = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < drive.size(); ++i) {
    const RunFrame& frame = record.frames()[i];
    EXPECT_EQ(frame.map_id, 0u) << i;
    if (drive.frame(i).speed == 0 && drive.frame(i - 1).speed == 0) {
      if (standing++ == 0) stop = record.frames()[i - 1].T_o_c.translation();
      EXPECT_LT((frame.T_o_c.translation() - stop).norm(), 0.05) << i;
      EXPECT_NE(frame.scale.status, ScaleStatus::kOk) << "standstill in frame " << i;
    }
    if (frame.scale.status != ScaleStatus::kOk) continue;
    ++measured;
    const double step =
        (drive.frame(i).T_c0_c.translation() - drive.frame(i - 1).T_c0_c.translation()).norm();
    const double vo_step =
        (frame.T_w_c.translation() - record.frames()[i - 1].T_w_c.translation()).norm();
    within_2_sigma += std::abs(frame.scale.scale - step / vo_step) < 2 * frame.scale.sigma;
    EXPECT_NEAR(frame.scale.n_c.dot(drive.frame(i).n_c), 1, 0.002) << i;
  }
  EXPECT_GE(standing, 49u);
  EXPECT_GT(measured, 120u);
  EXPECT_GT(within_2_sigma, measured * 7 / 10);  // the true scale of a single step is itself noisy
}

TEST(Pipeline, TheSameInputTwiceGivesTheSameBytes) {
  SyntheticDrive::Options drive_options = smallImages();
  drive_options.frames = 60;
  const auto run = [&] {
    const RunRecord record = runOffline(SyntheticDrive(drive_options), optionsFor(1.65));
    std::vector<double> numbers;
    for (const RunFrame& frame : record.frames()) {
      numbers.insert(numbers.end(), frame.T_o_c.data(), frame.T_o_c.data() + 16);
      numbers.insert(numbers.end(), frame.covariance.data(), frame.covariance.data() + 36);
    }
    return std::pair(scaleCsv(record), numbers);
  };
  EXPECT_TRUE(run() == run());
}

TEST(MetricOdometry, WithoutAScaleItIsInitialising) {
  MetricOdometry::Output output;
  output.vo.frame.status = VoStatus::kTracking;
  EXPECT_EQ(output.status(), VoStatus::kInitialising);
  output.vo.frame.status = VoStatus::kLost;
  EXPECT_EQ(output.status(), VoStatus::kLost);
}

TEST(Pipeline, TheOptionsOfThePaperRun) {
  SyntheticDrive::Options drive_options = smallImages();
  drive_options.frames = 60;
  const SyntheticDrive drive(drive_options);
  OfflineRun::Options literal = optionsFor(1.65);
  const auto root = std::filesystem::path(__FILE__).parent_path() / "../..";
  for (const std::string& option : readOptions((root / "config/paper.yaml").string())) {
    setOption(literal, option);
  }
  const RunRecord record = runOffline(drive, literal);
  EXPECT_TRUE(record.frames().back().has_metric_pose);
  EXPECT_LT(computeOdometryMetrics(groundTruth(drive), record.metricPoses()).rle_percent.value(),
            15.0);
}

/// Thresholds of a sequence. Metric: of the whole pipeline. Odometry: of the trajectory up to
/// scale, which does not depend on the scale stage.
using Threshold = std::optional<double>;
constexpr std::nullopt_t kAny = std::nullopt;  // no threshold
struct DataSequence {
  const char* name;      ///< its folder
  Threshold rle, t_err;  // metric [%]; t_err is the devkit's
  /// Odometry: the devkit's rotation error [deg/m], its translation error with the step lengths of
  /// the ground truth [%], and after a similarity alignment of the trajectory [%].
  Threshold r_err, true_length, sim3;
  /// Share of frames whose true scale is within 2 sigma.
  double min_share_within_2_sigma, max_share_within_2_sigma;
  Threshold height_bias;  // [%], absolute
};

// At least 1.3 times the measured values, as changes of the tracker without a significant effect on
// 95 drives vary them that much, and 0.05 % more for small ones. Within 2 sigma: the target is 0.85
// to 0.99, but the errors of frames less than about 10 m apart are correlated: kitti_05, kitti_06,
// kitti_00, rendered_09 and kitti_raw_0926_0039 have only 3, 6, 14, 17 and 29 independent samples.
// The ground truth of the first 14 of 200 frames of kitti_00 is extrapolated.
// clang-format off
const DataSequence kDataSequences[] = {
    // name                 rle  t_err r_err   true  sim3  2 sigma     height
    {"kitti_00_0000_0199",  2.4, 2.0,  0.023,  1.5,  4.3,  0.75, 0.99, kAny},
    {"kitti_raw_0926_0039", 0.5, 0.9,  0.0014, 0.8,  2.0,  0.85, 1.00, kAny},
    {"rendered_04",         0.3, 0.3,  0.0005, 0.07, kAny, 0.85, 0.99, 0.3},
    {"rendered_09_traffic", 0.5, 0.5,  0.0017, 0.07, kAny, 0.85, 1.00, 0.3},
    {"kitti_05_0100_0159",  2.0, kAny, kAny,   kAny, kAny, 0.85, 1.00, kAny},
    {"kitti_06_0000_0050",  2.0, kAny, kAny,   kAny, kAny, 0.85, 1.00, kAny},
};
// clang-format on

void expectAtMost(std::optional<double> value, const Threshold& threshold,
                  const std::string& what) {
  if (!threshold) return;
  ASSERT_TRUE(value) << what;
  EXPECT_LE(*value, *threshold) << what;
}

class SequencePipeline : public testing::TestWithParam<DataSequence> {};

TEST_P(SequencePipeline, MeetsItsThresholds) {
  const std::filesystem::path folder = dataPath(GetParam().name);
  if (folder.empty()) GTEST_SKIP() << "GROUND_SCALE_VO_DATA has no " << GetParam().name;
  const KittiSequence sequence(folder);
  OfflineRun offline(sequence.camera(), withExactHeight(1.65));
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    offline.process(sequence.image(i), sequence.stampNs(i));
  }
  const RunRecord& record = offline.record();
  EXPECT_EQ(record.trackedFrames(), sequence.size());
  EXPECT_EQ(record.lostEvents(), 0u);
  const DataSequence& thresholds = GetParam();
  const auto metric = computeOdometryMetrics(sequence.groundTruth(), record.metricPoses());
  expectAtMost(metric.rle_percent.value(), thresholds.rle, "relative length error");
  expectAtMost(metric.t_err_percent, thresholds.t_err, "translation error");
  const auto odometry = computeOdometryMetrics(sequence.groundTruth(), record.unscaledPoses());
  expectAtMost(odometry.r_err_deg_per_m, thresholds.r_err, "rotation error");
  expectAtMost(odometry.t_err_true_length_percent, thresholds.true_length,
               "translation error with true step lengths");
  expectAtMost(odometry.t_err_sim3_percent, thresholds.sim3,
               "translation error after a similarity alignment");
  const bool is_exact = !sequence.groundTruthHeights().empty();
  const ScaleMetrics scale =
      computeScaleMetrics(record, sequence.groundTruth(),
                          is_exact ? kExactGroundTruthDistance : kMeasuredGroundTruthDistance,
                          sequence.groundTruthHeights());
  EXPECT_GE(scale.within_2_sigma, thresholds.min_share_within_2_sigma);
  EXPECT_LE(scale.within_2_sigma, thresholds.max_share_within_2_sigma);
  if (thresholds.height_bias) {
    EXPECT_LE(std::abs(scale.height_bias_percent), *thresholds.height_bias);
  }
}

INSTANTIATE_TEST_SUITE_P(Data, SequencePipeline, testing::ValuesIn(kDataSequences),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace gsv
