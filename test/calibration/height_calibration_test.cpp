#include "ground_scale_vo/calibration/height_calibration.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "ground_scale_vo/evaluation/odometry_metrics.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
namespace {

using Status = HeightCalibration::Status;
using Result = HeightCalibration::Result;

constexpr double kHeight = 1.5;                 // true camera height of the scripted drives [m]
constexpr double kPitch = 0.03, kRoll = -0.02;  // true mounting of the scripted drives [rad]
constexpr std::int64_t kPeriodNs = 100000000;   // 10 Hz

/// The record of a curved drive with a nominal height of 1 m, and its ground truth.
struct ScriptedDrive {
  RunRecord record;
  std::vector<StampedPosition> positions;  // ground truth
  double length = 0;                       // ground truth [m]
};

/// Ranges of frames exclude their end (`_to`). Noises are standard deviations.
struct Script {
  int frames = 400;
  double speed = 8;  // [m/s]
  int stand_from = 0, stand_to = 0;
  int held_from = 0, held_to = 0;  // the scale is held, with a wrong plane
  int lost_from = 0, lost_to = 0;
  int initialised_at = 0;         // frames before it have no pose
  int scaled_at = 0;              // frames before it have no scale
  double scale_noise = 0;         // of the length of one step, relative
  double noise_correlation = 20;  // of the scale noise [frames]
  double standing_noise = 0;      // of the odometry's position at standstill, along x [m]
  double position_noise = 0;      // of a ground truth position, per axis [m]
  int position_every = 1;         // interval of the ground truth positions [frames]
  unsigned seed = 1;
};

ScriptedDrive drive(const Script& script) {
  std::mt19937 random(script.seed);
  std::normal_distribution<double> normal;
  ScriptedDrive result;
  Eigen::Vector3d p = Eigen::Vector3d::Zero(), estimated = p;
  double scale_error = 0;  // relative, a first-order Gauss-Markov process
  std::uint32_t map = 0;
  for (int i = 0; i < script.frames; ++i) {
    const bool stands = i >= script.stand_from && i < script.stand_to;
    const double heading = 0.6 * std::sin(0.01 * i);
    const Eigen::Vector3d step = (i == 0 || stands ? 0 : script.speed * 0.1) *
                                 Eigen::Vector3d(std::sin(heading), 0, std::cos(heading));
    const double correlation = 1 - 1 / script.noise_correlation;  // from one frame to the next
    scale_error = correlation * scale_error +
                  std::sqrt(1 - correlation * correlation) * script.scale_noise * normal(random);
    p += step;
    result.length += step.norm();

    VisualOdometry::Output vo;
    vo.frame.sequence = static_cast<std::uint32_t>(i);
    vo.frame.stamp_ns = kPeriodNs * i;
    ScaleRecovery::Output scale;
    const bool lost = i >= script.lost_from && i < script.lost_to;
    if (lost) {
      map = 1;
      vo.frame.status = VoStatus::kLost;
    } else if (i < script.initialised_at) {
      vo.frame.status = VoStatus::kInitialising;
    } else {
      estimated += step / kHeight * (1 + scale_error);
      vo.frame.status = VoStatus::kTracking;
      Eigen::Vector3d measured = estimated;
      if (stands) measured.x() += script.standing_noise * normal(random) / kHeight;
      vo.frame.T_w_c.translation() = measured;
      const bool held = i >= script.held_from && i < script.held_to;
      scale.scale.status = stands || held ? ScaleStatus::kHeld : ScaleStatus::kOk;
      scale.scale.measurement =
          stands ? MeasurementStatus::kStandstill : MeasurementStatus::kMeasured;
      scale.scale.scale = 1;
      scale.scale.height = 1;
      scale.scale.sigma = 0.01;
      const double pitch = (held ? 0.5 : kPitch) + 0.005 * normal(random);
      const double roll = kRoll + 0.005 * normal(random);
      scale.scale.n_c = {-std::sin(roll), -std::cos(roll) * std::cos(pitch),
                         -std::cos(roll) * std::sin(pitch)};
      scale.pose.emplace();
      scale.pose->T_o_c.translation() = measured;
      if (i < script.scaled_at) scale = {};
    }
    vo.frame.map_id = map;
    result.record.append(vo, scale);
    if (i % script.position_every != 0) continue;
    const Eigen::Vector3d noise(normal(random), normal(random), normal(random));
    // The positions are in another, rotated and translated frame: the result must not depend on it.
    result.positions.push_back({kPeriodNs * i, Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX()) * p +
                                                   script.position_noise * noise +
                                                   Eigen::Vector3d(500, 0, 3)});
  }
  return result;
}

Result byLength(const ScriptedDrive& drive, double sigma = 0) {
  return HeightCalibration({}).fromLength(drive.record, 1, drive.length, sigma);
}
Result byPositions(const ScriptedDrive& drive, double sigma = 0) {
  return HeightCalibration({}).fromPositions(drive.record, 1, drive.positions, sigma);
}

TEST(HeightCalibration, IsExactWithoutNoise) {
  for (const Result& result : {byLength(drive({})), byPositions(drive({}))}) {
    ASSERT_EQ(result.status, Status::kOk) << result.reason;
    EXPECT_NEAR(result.height.value, kHeight, 0.001);
    ASSERT_TRUE(result.pitch && result.roll);
    EXPECT_NEAR(result.pitch->value, kPitch, 2 * result.pitch->sigma);
    EXPECT_NEAR(result.roll->value, kRoll, 2 * result.roll->sigma);
    EXPECT_LT(result.pitch->sigma, 0.001);
    for (std::size_t i = 1; i < result.segments.size(); ++i) {
      EXPECT_EQ(result.segments[i].from_ns, result.segments[i - 1].to_ns);
    }
  }
}

TEST(HeightCalibration, HeightIsProportionalToTheLength) {
  Script script;
  script.scale_noise = 0.01;
  ScriptedDrive scripted = drive(script);
  const Result length = byLength(scripted, 1), positions = byPositions(scripted);
  scripted.length *= 1.07;
  for (StampedPosition& position : scripted.positions) position.p *= 1.07;
  const Result length2 = byLength(scripted, 1.07), positions2 = byPositions(scripted);
  EXPECT_NEAR(length2.height.value, 1.07 * length.height.value, 1e-9);
  EXPECT_NEAR(length2.height.sigma, 1.07 * length.height.sigma, 1e-9);
  EXPECT_NEAR(positions2.height.value, 1.07 * positions.height.value, 1e-9);
  EXPECT_NEAR(positions2.height.sigma, 1.07 * positions.height.sigma, 1e-9);
}

/// Share of the seeds whose 95 % interval contains the true height. Raises *widest to the largest
/// half width of an interval, relative to the height.
double coverage(Script script, int seeds, double* widest) {
  int within = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    script.seed = static_cast<unsigned>(seed);
    const Result result = byPositions(drive(script));
    EXPECT_EQ(result.status, Status::kOk) << result.reason;
    within += std::abs(result.height.value - kHeight) < result.height.error95();
    *widest = std::max(*widest, result.height.error95() / kHeight);
  }
  return static_cast<double>(within) / seeds;
}

TEST(HeightCalibration, The95PercentIntervalContainsTheTrueHeight) {
  // Errors correlated over three segments (of 12 camera heights, 22 frames, each).
  Script script;
  script.frames = 1500;
  script.scale_noise = 0.02;
  script.noise_correlation = 60;
  double widest = 0;
  EXPECT_GE(coverage(script, 100, &widest), 0.88);
  EXPECT_LT(widest, 0.03);
  // Six segments with independent errors.
  script.frames = 140;
  script.scale_noise = 0.07;
  script.noise_correlation = 1;
  EXPECT_GE(coverage(script, 400, &widest), 0.95);
  EXPECT_LT(widest, 0.05);
}

// The sum of the distances between positions would be 50 % too long here.
TEST(HeightCalibration, NoiseOfThePositionsDoesNotBiasTheHeight) {
  double sum = 0;
  int within = 0;
  constexpr int kSeeds = 20;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    Script script;
    script.frames = 1500;
    script.position_noise = 2;
    script.position_every = 5;
    script.seed = seed;
    const Result result = byPositions(drive(script), 2);
    ASSERT_EQ(result.status, Status::kOk) << result.reason;
    // segment_position_sigmas, 40, times 2 m
    EXPECT_GT(result.segments.front().length_heights * kHeight, 75);
    sum += result.height.value;
    within += std::abs(result.height.value - kHeight) < result.height.error95();
  }
  EXPECT_NEAR(sum / kSeeds, kHeight, 0.003 * kHeight);
  EXPECT_GE(within, kSeeds * 8 / 10);
}

TEST(HeightCalibration, StandstillIsIgnored) {
  Script script;
  script.stand_from = 150;
  script.stand_to = 250;
  script.standing_noise = 0.02;
  EXPECT_NEAR(byLength(drive(script)).height.value, kHeight, 0.001);
  const Result result = byPositions(drive(script));
  EXPECT_NEAR(result.height.value, kHeight, 0.001);
  EXPECT_TRUE(std::any_of(result.segments.begin(), result.segments.end(), [](const auto& segment) {
    return segment.from_ns < 150 * kPeriodNs && segment.to_ns > 250 * kPeriodNs;
  }));
}

TEST(HeightCalibration, SegmentsAreMeasuredInAtLeastHalfOfTheMovingFrames) {
  Script script;
  script.held_from = 100;
  script.held_to = 160;
  const Result result = byPositions(drive(script));
  ASSERT_EQ(result.status, Status::kOk) << result.reason;
  EXPECT_LT(result.segments.size(), byPositions(drive({})).segments.size());
  for (const auto& segment : result.segments) {
    const auto first = segment.from_ns / kPeriodNs, last = segment.to_ns / kPeriodNs;
    const auto held = std::min<std::int64_t>(last, script.held_to - 1) -
                      std::max<std::int64_t>(first, script.held_from) + 1;
    EXPECT_LE(2 * held, last - first + 1) << first << " to " << last;
  }
  EXPECT_NEAR(result.pitch->value, kPitch, 0.003);
}

TEST(HeightCalibration, AfterATrackingLossOnlyPositionsGiveAHeight) {
  Script script;
  script.lost_from = 180;
  script.lost_to = 200;
  for (const int every : {1, 30}) {  // 30: the loss is between the positions of frames 180 and 210
    script.position_every = every;
    const Result result = byPositions(drive(script));
    ASSERT_EQ(result.status, Status::kOk) << result.reason;
    EXPECT_NEAR(result.height.value, kHeight, 0.001);
    const std::int64_t end = every == 1 ? 200 : 210;
    for (const auto& segment : result.segments) {
      EXPECT_TRUE(segment.to_ns <= 180 * kPeriodNs || segment.from_ns >= end * kPeriodNs);
    }
  }
}

TEST(HeightCalibration, AnUnobservedPartOfTheDistanceGivesNoHeightFromTheLength) {
  Script lost, first_map_without_scale, late;
  lost.lost_from = 180;
  lost.lost_to = 200;
  first_map_without_scale.lost_from = 90;
  first_map_without_scale.lost_to = first_map_without_scale.scaled_at = 100;
  late.initialised_at = 12;
  for (const auto& [script, reason] : {std::pair(lost, "lost at or before frame 180"),
                                       std::pair(first_map_without_scale, "before frame 100"),
                                       std::pair(late, "before frame 12")}) {
    const Result result = byLength(drive(script));
    EXPECT_EQ(result.status, Status::kBroken);
    EXPECT_NE(result.reason.find(reason), std::string::npos) << result.reason;
  }
}

TEST(HeightCalibration, OutlierSegmentsAreRejected) {
  ScriptedDrive scripted = drive({});
  for (std::size_t i = 200; i < scripted.positions.size(); ++i) {
    scripted.positions[i].p += Eigen::Vector3d(5, 5, 5);  // a jump of the GNSS receiver
  }
  const Result result = byPositions(scripted);
  ASSERT_EQ(result.status, Status::kOk) << result.reason;
  EXPECT_NEAR(result.height.value, kHeight, 0.001);
  int rejected = 0;
  for (const auto& segment : result.segments) rejected += !segment.used;
  EXPECT_EQ(rejected, 1);
}

TEST(HeightCalibration, FailuresHaveAStatus) {
  Script script;
  script.frames = 60;
  EXPECT_EQ(byPositions(drive(script)).status, Status::kTooFew);
  const Result uncertain = byLength(drive({}), 0.03 * drive({}).length);
  EXPECT_EQ(uncertain.status, Status::kTooUncertain);
  EXPECT_NE(uncertain.reason.find("1.50 m"), std::string::npos) << uncertain.reason;
  EXPECT_NE(uncertain.reason.find("more than 5.0 %"), std::string::npos) << uncertain.reason;
  ScriptedDrive an_hour_later = drive({});
  for (StampedPosition& position : an_hour_later.positions) position.stamp_ns += 3600000000000;
  EXPECT_EQ(byPositions(an_hour_later).status, Status::kTooFew);
  script.initialised_at = script.frames;
  EXPECT_EQ(byPositions(drive(script)).status, Status::kNoScale);
  EXPECT_EQ(byLength(drive(script)).status, Status::kNoScale);
  EXPECT_THROW(HeightCalibration({}).fromLength(an_hour_later.record, 1, 0, 0), OptionError);
  const std::vector<StampedPosition> repeated_stamp(2);
  EXPECT_THROW(HeightCalibration({}).fromPositions(an_hour_later.record, 1, repeated_stamp, 0),
               OptionError);
}

/// Record of a run over all images of the drive, with a nominal height of 1 m. stamp(i): of image i
/// [ns].
template <typename Drive, typename Stamp>
RunRecord run(const Drive& drive, const PinholeCamera& camera, const Stamp& stamp) {
  OfflineRun::Options options;
  options.scale.camera_height = 1;
  OfflineRun offline(camera, options);
  for (std::size_t i = 0; i < drive.size(); ++i) offline.process(drive.image(i), stamp(i));
  return offline.record();
}

TEST(HeightCalibration, OfARenderedDriveIsWithinItsErrorBounds) {
  constexpr double kTrueHeight = 1.2;
  SyntheticDrive::Options options;
  options.camera_height = kTrueHeight;
  options.pitch_rad = 0.05;
  options.speed = 14;
  options.stop_s = 0;
  options.frames = 60;
  options.camera = {620, 188, 359.6, 359.6, 309.5, 93.5};
  const SyntheticDrive drive(options);
  const RunRecord record =
      run(drive, drive.camera(), [&](auto i) { return drive.frame(i).stamp_ns; });
  std::vector<StampedPosition> ground_truth;
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    poses.push_back(drive.frame(i).T_c0_c);
    ground_truth.push_back({drive.frame(i).stamp_ns, poses.back().translation()});
  }
  const HeightCalibration calibration({});
  const Result positions = calibration.fromPositions(record, 1, ground_truth, 0);
  const Result length = calibration.fromLength(record, 1, pathLength(poses), 0);
  for (const Result& result : {positions, length}) {
    ASSERT_EQ(result.status, Status::kOk) << result.reason;
    EXPECT_NEAR(result.height.value, kTrueHeight, 2 * result.height.sigma);
    EXPECT_NEAR(result.height.value, kTrueHeight, 0.01 * kTrueHeight);
    ASSERT_TRUE(result.pitch && result.roll);
    EXPECT_NEAR(result.pitch->value, 0.05, 0.006);
    EXPECT_NEAR(result.roll->value, 0, 0.006);
  }
}

TEST(HeightCalibration, AgreesWithKittisCameraHeight) {
  const auto folder = dataPath("kitti_raw_0926_0039");
  if (folder.empty()) GTEST_SKIP() << "GROUND_SCALE_VO_DATA has no kitti_raw_0926_0039";
  const KittiSequence sequence(folder);
  const RunRecord record =
      run(sequence, sequence.camera(), [&](auto i) { return sequence.stampNs(i); });
  std::vector<std::int64_t> stamps;
  for (std::size_t i = 0; i < sequence.size(); ++i) stamps.push_back(sequence.stampNs(i));
  const Result result = HeightCalibration({}).fromPositions(
      record, 1, readStampedPositions(folder / "poses.txt", stamps), 0);
  ASSERT_EQ(result.status, Status::kOk) << result.reason;
  EXPECT_NEAR(result.height.value, 1.65, result.height.error95());
  EXPECT_LT(result.height.error95(), 0.01 * 1.65);
}

}  // namespace
}  // namespace ground_scale_vo
