// The reported covariances are consistent with the errors of the last position and of the twists
// (normalised errors), on drives with different roads and cameras, none of them difficult.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/drive_run.hpp"
#include "support/twist_errors.hpp"

namespace gsv {
namespace {

using DriveOptions = SyntheticDrive::Options;

struct ShortDrive {
  const char* name;
  void (*configure)(DriveOptions&);
};
const ShortDrive kDrives[] = {
    {"flat and straight", [](DriveOptions& o) { o.curvature = o.slope = 0; }},
    {"default", [](DriveOptions&) {}},
    {"a steeper hill", [](DriveOptions& o) { o.slope = 0.05; }},
    {"sharper bends", [](DriveOptions& o) { o.curvature = 0.05, o.speed = 6; }},
    {"a lower camera", [](DriveOptions& o) { o.camera_height = 1.2, o.speed = 7; }},
    {"a higher camera", [](DriveOptions& o) { o.camera_height = 2.2; }},
    {"faster, no traffic", [](DriveOptions& o) { o.speed = 14, o.moving_cars = false; }},
    {"pitched and rolled", [](DriveOptions& o) { o.pitch_rad = 0.06, o.roll_rad = 0.02; }},
};

/// Error of the last position relative to the first one of the map, along the line between both,
/// over its standard deviation.
double normalisedError(const SyntheticDrive& drive, const RunRecord& record) {
  const auto& frames = record.frames();
  const auto first = std::find_if(frames.begin(), frames.end(),
                                  [](const RunFrame& frame) { return frame.has_vo_pose; });
  if (first == frames.end() || !frames.back().has_metric_pose || frames.back().map_id != 0) {
    ADD_FAILURE() << "no metric pose in the first map";
    return 0;
  }
  const Eigen::Vector3d truth =
      (drive.frame(static_cast<std::size_t>(first - frames.begin())).T_c0_c.inverse() *
       drive.frame(drive.size() - 1).T_c0_c)
          .translation();
  const Eigen::Vector3d estimate = (first->T_o_c.inverse() * frames.back().T_o_c).translation();
  const Eigen::Vector3d along = truth.normalized();
  const Eigen::Matrix3d covariance = frames.back().covariance.topLeftCorner<3, 3>();
  return along.dot(estimate - truth) / std::sqrt(along.dot(covariance * along));
}

// For a consistent covariance the RMS normalised error is 1. It is smaller here, as rendered
// cameras have no calibration error, of which the covariance takes account.
TEST(Covariance, AgreesWithTheErrorsOfTheLastPositionAndOfTheTwists) {
  double sum = 0;
  bool is_reduced = false;
  TwistErrors twists;
  for (std::size_t i = 0; i < std::size(kDrives); ++i) {
    SCOPED_TRACE(kDrives[i].name);
    DriveOptions options = mediumImages();
    options.frames = 52;
    options.stop_s = 0;
    options.random_seed = 11 + i;
    kDrives[i].configure(options);
    is_reduced = isReduced(options);
    const SyntheticDrive drive(reducedDrive(options));
    OfflineRun run(drive.camera(), withExactHeight(options.camera_height));
    for (std::size_t k = 0; k < drive.size(); ++k) {
      const bool follows = run.last().pose().has_value();
      run.process(drive.image(k), drive.frame(k).stamp_ns);
      if (follows && run.last().pose()) twists.add(drive, k, *run.last().pose());
    }
    if (is_reduced) continue;
    // Of the position, in whose direction of motion the error of the scale grows with the path.
    const auto& frames = run.record().frames();
    const auto variance = [&](std::size_t k) {
      return frames[k].covariance.topLeftCorner<3, 3>().trace();
    };
    EXPECT_GT(variance(frames.size() - 1), 1.3 * variance(2 * frames.size() / 3));
    sum += std::pow(normalisedError(drive, run.record()), 2);
  }
  if (is_reduced) return;
  const double rms = std::sqrt(sum / static_cast<double>(std::size(kDrives)));
  EXPECT_GT(rms, 0.30);  // of eight samples, it varies by up to a factor of two
  EXPECT_LT(rms, 2);
  ASSERT_GT(twists.count, 300);
  const Vector6d twist_rms = twists.rms();
  EXPECT_GT(twist_rms.minCoeff(), 0.25) << twist_rms.transpose();
  EXPECT_LT(twist_rms.maxCoeff(), 1.2) << twist_rms.transpose();
}

}  // namespace
}  // namespace gsv
