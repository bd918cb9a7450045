#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/calibration/lens_calibration.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"
#include "ground_scale_vo/lens/lens.hpp"
#include "ground_scale_vo/metric_odometry.hpp"

namespace gsv {

/// The lens that a whole drive shows.
struct DriveLens {
  /// The drive's own where it confirms the calibration or does not determine the lens.
  LensEstimate estimate;
  std::string contradiction;  ///< LensEstimator::Result::contradiction, while `estimate` is its own
};

/// The odometry of a drive, without ROS.
struct DriveRun {
  struct Options {
    MetricOdometry::Options odometry;
    /// GROUP/NAME=VALUE, as of --set: takes precedence over the readout time of the calibration.
    std::vector<std::string> settings;
    /// In the order of their stamps; not empty: sets use_speed. A speed is known from its stamp on.
    std::vector<SpeedSample> speeds;
    double speed_offset = 0;  ///< added to their stamps [s]
    /// Not causal: the record is that of RunRecord::smooth(). `lens` is used from the start, and
    /// not refined any more.
    bool smooth = false;
    std::optional<DriveLens> lens;  ///< instead of the refined one
  };
  using OnFrame = std::function<void(const RunFrame& frame)>;

  RunRecord record;  ///< a frame for every image, also those that are not used
  Lens given_lens;   ///< of the calibration
  LensEstimate lens;
  double readout_time = 0;            ///< [s] of the odometry
  std::size_t used = 0;               ///< images
  std::vector<std::string> warnings;  ///< sentences of DriveReader, and about the result
  /// Why the result is not that of the whole drive, or empty: DriveReader::failure(), speeds of
  /// another clock or unit, failureOf(), or that the motion contradicts the calibration.
  std::string failure;

  /// One line: images read, used and not used; share of the frames with a held scale; where the
  /// first metric pose is; length with its standard deviation; camera height, if speeds are used.
  std::string summary() const;
  /// 0; 1 with a failure, or if is_strict with a warning.
  int exitStatus(bool is_strict) const {
    return !failure.empty() || (is_strict && !warnings.empty());
  }
};

/// For DriveRun::Options. images: of `drive`, read anew at each call. is_rough: the calibration is
/// that of a field of view; throws DataError if the drive does not determine the lens.
DriveLens lensOfDrive(const RepeatableDrive& images, const DriveReader& drive,
                      const DriveRun::Options& options, bool is_rough = false);

/// Runs MetricOdometry over the images. on_frame: is called after each one. Throws DataError, and
/// OptionError: options or settings.
DriveRun runDrive(DriveReader* drive, DriveRun::Options options, const DriveRun::OnFrame& on_frame);

/// Name of the result folder: that of the drive's folder, or of its file without extension.
std::string resultName(const std::string& drive);

/// writeRun(), run.json with failure, warnings and lens, and camera.yaml if the lens was refined.
/// Throws DataError.
void writeRun(const std::filesystem::path& folder, const DriveRun& run, double camera_height,
              const GroundTruth& truth);

}  // namespace gsv
