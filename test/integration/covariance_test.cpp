#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <optional>
#include <vector>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "support/drive_run.hpp"
#include "support/reduced_drive.hpp"

// Consistency test (normalised error) of the reported covariance on drives with different roads and
// cameras, none of them difficult.

namespace ground_scale_vo {
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

DriveOptions shortDrive(std::size_t i) {
  DriveOptions options = mediumImages();
  options.frames = 52;
  options.stop_s = 0;
  options.random_seed = 11 + i;
  kDrives[i].configure(options);
  return options;
}

/// Error of the last position and its sigma, both along the line from the first to the last
/// position of the ground truth.
struct EndPoint {
  double distance = 0, error = 0, sigma = 0;  ///< [m]
  double normalisedError() const { return error / sigma; }
};

EndPoint evaluateEnd(const Eigen::Isometry3d& ground_truth, const MetricPose& pose) {
  const Eigen::Vector3d along = ground_truth.translation().normalized();
  const Eigen::Matrix3d covariance = pose.covariance.topLeftCorner<3, 3>();
  return {ground_truth.translation().norm(),
          along.dot(pose.T_o_c.translation() - ground_truth.translation()),
          std::sqrt(along.dot(covariance * along))};
}

struct EndPoints {
  EndPoint whole;        ///< as published, from the first frame of the map
  EndPoint since_scale;  ///< from the first metric pose, without the motion before it
};

/// Empty without a metric pose at the end, or when the odometry had to start a second map.
std::optional<EndPoints> runDrive(const DriveOptions& drive_options) {
  const SyntheticDrive drive(reducedDrive(drive_options));
  ScaleRecovery::Options options;
  options.camera_height = drive.cameraHeight();
  VisualOdometry odometry(drive.camera(), {});
  ScaleRecovery recovery(options);
  MetricTrajectory since_scale_trajectory(options.trajectory);
  std::size_t map_start = 0;
  std::optional<std::size_t> first_metric;
  Eigen::Isometry3d T_first_w = Eigen::Isometry3d::Identity();
  std::optional<MetricPose> whole, since_scale;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const cv::Mat image = drive.image(i);
    VisualOdometry::Output vo = odometry.process(image, drive.frame(i).stamp_ns);
    if (vo.frame.map_id != 0) return {};
    if (!vo.start.empty()) map_start = vo.start.front().sequence;
    const ScaleRecovery::Output scale = recovery.process(vo.frame, image);
    whole = scale.pose;
    if (!whole) continue;
    if (!first_metric) {
      first_metric = i;
      T_first_w = vo.frame.T_w_c.inverse();
    }
    vo.frame.T_w_c = T_first_w * vo.frame.T_w_c;
    since_scale = since_scale_trajectory.append(vo.frame, scale.scale);
  }
  if (!whole) return {};
  const auto groundTruthFrom = [&](std::size_t first) {
    return drive.frame(first).T_c0_c.inverse() * drive.frame(drive.size() - 1).T_c0_c;
  };
  return EndPoints{evaluateEnd(groundTruthFrom(map_start), *whole),
                   evaluateEnd(groundTruthFrom(*first_metric), *since_scale)};
}

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

TEST(Covariance, IsNotOverconfidentAboutTheLastPosition) {
  std::vector<double> whole, since_scale;
  std::printf("%-20s error, sigma [m], normalised: %-21s since the first scale\n", "",
              "as published");
  for (std::size_t i = 0; i < std::size(kDrives); ++i) {
    const std::optional<EndPoints> ends = runDrive(shortDrive(i));
    if (isReduced(shortDrive(i))) continue;
    ASSERT_TRUE(ends) << kDrives[i].name;
    std::printf("%-20s", kDrives[i].name);
    for (const EndPoint& end : {ends->whole, ends->since_scale}) {
      std::printf("  of %4.1f m: %+.3f %.3f %+.2f", end.distance, end.error, end.sigma,
                  end.normalisedError());
    }
    std::printf("\n");
    whole.push_back(ends->whole.normalisedError());
    since_scale.push_back(ends->since_scale.normalisedError());
  }
  if (isReduced(shortDrive(0))) return;
  std::printf("RMS normalised error: %.2f, since the first scale %.2f\n", rms(whole),
              rms(since_scale));
  // For a consistent covariance the RMS normalised error is 1; with eight samples it varies by up
  // to a factor of two. It is 0.54 and 0.45: rendered cameras have no calibration error, of which
  // the covariance takes account.
  constexpr double kMaxNormalisedError = 2;
  // Two thirds of the smaller value: fails when sigma becomes considerably more conservative.
  constexpr double kMinNormalisedError = 0.30;
  for (const double normalised_error : {rms(whole), rms(since_scale)}) {
    EXPECT_GT(normalised_error, kMinNormalisedError);
    EXPECT_LT(normalised_error, kMaxNormalisedError);
  }
}

}  // namespace
}  // namespace ground_scale_vo
