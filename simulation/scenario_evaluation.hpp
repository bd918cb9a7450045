#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "simulation/scenarios.hpp"
#include "simulation/synthetic_drive.hpp"

namespace gsv {

/// Accuracy of a run over a scenario, against exact ground truth.
struct ScenarioMetrics {
  std::size_t frames = 0;
  std::size_t tracked_frames = 0;
  std::size_t lost_events = 0;
  std::size_t metric_frames = 0;  ///< from the first metric pose on

  // Errors of the trajectory from the first metric pose on; NaN without one.
  double rle_percent = 0;
  double t_err_short_percent = 0;
  /// Error of the displacement from the first metric pose to the last frame, along the
  /// displacement, over its published standard deviation (relativePoseError()); NaN when the last
  /// frame has no metric pose.
  double displacement_sigmas = 0;

  /// Angle of the error of the rotation from the first to the last image [deg].
  double rotation_error_deg = 0;

  double scale_error_percent = 0;  ///< ScaleMetrics::error_abs_median_percent
  double within_2_sigma = 0;       ///< ScaleMetrics::within_2_sigma
  double held_share = 0;           ///< ScaleMetrics::held_share
  /// Share of the unobservable frames whose scale is reported as measured (kOk); 0 without such
  /// frames.
  double ok_while_unobservable = 0;

  // The reaction to Scenario::fault; 0 without one.

  /// Frames after the fault until a metric pose with a measured scale (kOk); -1: never.
  int recovery_frames = 0;
  /// Error of the position from 3 s and 20 m after the fault to the end of the drive, relative to
  /// the path length. (A new map needs some images, and its scale some distance.)
  double error_after_fault_percent = 0;
};

/// Renders all images of the drive.
std::vector<cv::Mat> renderDrive(const SyntheticDrive& drive);

/// What the odometry knows besides the images.
struct KnownLengths {
  bool camera_height = true;
  std::vector<SpeedSample> speeds;  ///< each is known from its stamp on; empty: not used
};

/// Runs the pipeline over the images of the drive, with default options except for its camera
/// height and the settings. mask: of MetricOdometry. Throws OptionError.
RunRecord runDrive(const SyntheticDrive& drive, const std::vector<cv::Mat>& images,
                   const std::vector<std::string>& settings = {}, const KnownLengths& known = {},
                   const cv::Mat& mask = {});

/// record: of all images of the drive. Throws OptionError when it has another length.
ScenarioMetrics evaluateScenario(const Scenario& scenario, const SyntheticDrive& drive,
                                 const RunRecord& record);

/// The first violated threshold: "lost" (too many frames are not tracked), "late scale" (too few
/// metric frames), "rotation", "RLE", "2 sigma", "ok while unobservable" or, after a fault, "no
/// recovery" or "error after the fault". Empty: none.
std::string violatedThreshold(const ScenarioMetrics& metrics, const ScenarioThresholds& thresholds);

}  // namespace gsv
