// Speeds of the vehicle, from the images to the metric pose.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/metrics.hpp"
#include "ground_scale_vo/evaluation/speed_file.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "simulation/scenario_evaluation.hpp"
#include "simulation/scenarios.hpp"
#include "simulation/speed_sensor.hpp"
#include "support/drive_run.hpp"
#include "support/temporary_folder.hpp"

namespace gsv {
namespace {

/// A rendered drive, whose images are used in several runs.
struct RenderedDrive {
  explicit RenderedDrive(const SyntheticDrive::Options& options)
      : drive(options), images(renderDrive(drive)) {}

  RunRecord run(const KnownLengths& known, const std::vector<std::string>& settings = {}) const {
    return runDrive(drive, images, settings, known);
  }
  double rle(const RunRecord& record) const {
    return computeOdometryMetrics(groundTruth(drive), record.metricPoses()).rle_percent.value();
  }

  SyntheticDrive drive;
  std::vector<cv::Mat> images;
};

const RenderedDrive& straightDrive() {
  static const RenderedDrive drive = [] {
    SyntheticDrive::Options options = mediumImages();
    options.frames = 60;
    return RenderedDrive(options);
  }();
  return drive;
}

bool warns(const RunRecord& record, const char* part) {
  return std::any_of(record.frames().begin(), record.frames().end(), [&](const RunFrame& frame) {
    return frame.speed_warning.find(part) != std::string::npos;
  });
}

TEST(Speed, AloneGivesTheScaleAndTeachesTheHeight) {
  const RenderedDrive& straight = straightDrive();
  const RunRecord record = straight.run({false, simulateSpeeds(straight.drive)});
  const ScaleEstimate& last = record.frames().back().scale;
  EXPECT_LT(straight.rle(record), 0.5);
  EXPECT_EQ(last.status, ScaleStatus::kOk);
  EXPECT_EQ(last.source, ScaleSource::kBoth);
  EXPECT_NEAR(last.camera_height, straight.drive.cameraHeight(), 3 * last.camera_height_sigma);
  EXPECT_LT(last.camera_height_sigma, 0.03);
  // The first metric pose needs a speed over a metre.
  const auto first = std::find_if(record.frames().begin(), record.frames().end(),
                                  [](const RunFrame& frame) { return frame.has_metric_pose; });
  EXPECT_LT(first->T_o_c.translation().norm(), 4);
}

TEST(Speed, FaultsOfTheSensorAreNamedAndDoLittleHarm) {
  const RenderedDrive& straight = straightDrive();
  const auto run = [&](SpeedFault fault) {
    return straight.run({true, simulateSpeeds(straight.drive, fault)});
  };
  const RunRecord slip = run(SpeedFault::kSlip), zero = run(SpeedFault::kZero);
  const RunRecord sign = run(SpeedFault::kSign), unit = run(SpeedFault::kUnit);
  EXPECT_LT(straight.rle(slip), 1);
  EXPECT_LT(straight.rle(zero), 1);
  EXPECT_LT(straight.rle(sign), 0.5);
  EXPECT_LT(straight.rle(unit), 3);
  EXPECT_LT(straight.rle(run(SpeedFault::kStuck)), 1);
  EXPECT_LT(straight.rle(run(SpeedFault::kLate)), 1);
  EXPECT_LT(straight.rle(run(SpeedFault::kGap)), 1);
  EXPECT_TRUE(warns(slip, "jumps to"));
  EXPECT_TRUE(warns(zero, "jumps to 0.00"));
  EXPECT_TRUE(warns(sign, "sign"));
  EXPECT_NE(unit.frames().back().speed_error.find("looks like km/h taken as m/s"),
            std::string::npos);
}

// The circumference of the wheels of another car, or the height of another camera.
TEST(Speed, ThatContradictsTheRoadAndTheHeightIsAnError) {
  const RenderedDrive& straight = straightDrive();
  for (const double factor : {1.0, 1.25}) {
    std::vector<SpeedSample> speeds = simulateSpeeds(straight.drive);
    for (SpeedSample& sample : speeds) sample.speed *= factor;
    const RunRecord record = straight.run({true, speeds});
    EXPECT_EQ(record.frames().back().speed_error.empty(), factor == 1)
        << record.frames().back().speed_error;
  }
}

// A lorry hides the road: only the speed tells that the vehicle stands, and how far it drives.
TEST(Speed, MeasuresWithoutARoadAndConfirmsAStandstill) {
  const RenderedDrive traffic(reducedDrive(findScenario("traffic_passes").options));
  const RunRecord record = traffic.run({true, simulateSpeeds(traffic.drive)});
  EXPECT_LT(traffic.rle(record), 0.5);
  int stands = 0;
  for (std::size_t i = 1; i < record.frames().size(); ++i) {
    const RunFrame &before = record.frames()[i - 1], &frame = record.frames()[i];
    if (traffic.drive.frame(i - 1).speed != 0 || traffic.drive.frame(i).speed != 0) continue;
    if (++stands < 3) continue;  // until the sensor has told it
    EXPECT_NEAR(distanceBetween(before.T_o_c, frame.T_o_c), 0, 1e-9) << i;
  }
  EXPECT_GT(stands, 20);
  for (const RunFrame& frame : record.frames()) {
    if (frame.scale.status != ScaleStatus::kHeld) continue;
    EXPECT_EQ(frame.scale.measurement, MeasurementStatus::kStandstill);
  }
}

// 1.65 m is KITTI's height.
TEST(Speed, OfAGpsTeachesTheHeightWithinAHundredMetres) {
  const std::filesystem::path folder = dataPath("kitti_raw_0926_0039");
  if (folder.empty()) GTEST_SKIP() << "GROUND_SCALE_VO_DATA has no kitti_raw_0926_0039";
  const KittiSequence sequence(folder);
  const std::vector<SpeedSample> speeds = readSpeeds(folder / "speed.csv", "mps", false);
  for (const double given : {0.0, 1.65 * 1.05}) {
    OfflineRun::Options options = optionsFor(given);
    options.scale.use_speed = true;
    options.scale.camera_height_sigma = 0.1;
    OfflineRun run(sequence.camera(), options);
    run.setSpeeds(speeds);
    double length = 0;
    for (std::size_t i = 0; i < sequence.size(); ++i) {
      run.process(sequence.image(i), sequence.stampNs(i));
      const double before = std::exchange(length, pathLength(run.record().metricPoses()));
      if (before < 100 && length >= 100) {
        EXPECT_NEAR(run.record().frames().back().scale.camera_height, 1.65, 0.02);
      }
    }
    EXPECT_NEAR(length, 288.0, 0.005 * 288);  // the integrated speed
  }
}

TEST(Speed, IsNotNeededButThenTheHeightIs) {
  MetricOdometry::Options options;
  EXPECT_THROW(options.validate(), OptionError);
  options.scale.use_speed = true;
  options.validate();
}

}  // namespace
}  // namespace gsv
