#pragma once

#include <cstddef>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/simulation/fault_drives.hpp"

namespace ground_scale_vo {

/// No number in the output is NaN or infinite, and no variance is negative. Excepted is
/// MapStart::rotation_sigma, infinite when the rotation is not known.
bool isFinite(const VisualOdometry::Output& vo);
bool isFinite(const ScaleRecovery::Output& scale);

/// The response of the pipeline to one fault. "Before" is the last frame before the fault, "after"
/// the first frame of the next fault-free segment.
struct FaultMetrics {
  std::string name;
  bool hides_ground = false;
  double duration_s = 0;
  /// From the first faulty frame until the status is LOST (odometry) or HELD (scale); NaN: never
  /// during the fault.
  double detection_delay_s = 0;
  /// Faulty frames after kMaxDetectionDelay whose scale is reported as measured (OK).
  std::size_t ok_frames = 0;
  /// Frames after the fault until TRACKING; -1: never.
  int tracking_recovery_frames = 0;
  /// Frames after the fault until a metric pose with a measured scale; -1: never.
  int metric_recovery_frames = 0;
  /// Estimated minus true path length from before to after, if positive [m].
  double excess_path_m = 0;
  double position_error_m = 0;  ///< of the relative position from before to after
  double sigma_m = 0;  ///< growth of the position covariance over it, as a standard deviation
};

/// A segment without faults, from where the odometry has settled to the next fault.
struct FaultFreeSegment {
  std::size_t first = 0, last = 0;  ///< frames
  double length_m = 0;              ///< true path length
  double error_percent = 0;  ///< error of the relative position from first to last, of its length
};

struct FaultDriveMetrics {
  std::size_t frames = 0;
  std::size_t tracked_frames = 0;
  std::size_t non_finite_frames = 0;
  std::vector<FaultMetrics> faults;
  std::vector<FaultFreeSegment> segments;
};

// Thresholds.
constexpr double kMaxDetectionDelay = 3;       ///< of a fault that hides the ground [s]
constexpr double kMinSegmentLength = 8;        ///< shorter segments are ignored [m]
constexpr double kMaxSegmentErrorPercent = 5;  ///< of FaultFreeSegment::error_percent
constexpr double kMaxErrorSigmas = 3;          ///< position error after a fault
/// Position error that is not attributed to the fault [m].
constexpr double kPositionTolerance = 1;
/// Share of the position error by which the estimated path may be longer than the true one, beyond
/// kPositionTolerance.
constexpr double kPathLengthTolerance = 0.05;

/// Renders the drive, injects the faults and runs the pipeline with default options except for
/// the camera height. each: called with every frame's image and outputs, may be empty.
FaultDriveMetrics runFaultDrive(
    const FaultDrive& drive,
    const std::function<void(std::size_t, const cv::Mat&, const OfflineRun&)>& each = {});

/// The first violated threshold as a sentence; empty: none. All outputs must be finite, every
/// segment accurate, hidden ground detected and then not measured, metric poses again after every
/// fault, no excess path length, and the position error after a fault consistent with the
/// covariance.
std::string violatedThreshold(const FaultDriveMetrics& metrics);

}  // namespace ground_scale_vo
