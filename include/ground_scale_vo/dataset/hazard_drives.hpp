#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/dataset/offline_run.hpp"
#include "ground_scale_vo/dataset/synthetic_drive.hpp"

namespace ground_scale_vo {

/// A short rendered drive with one thing in it that makes the scale hard to measure.
struct HazardDrive {
  /// Frames [first, last].
  struct Frames {
    std::size_t first, last;
  };

  std::string name;  ///< lower case, words joined by _
  std::string what;  ///< one line
  SyntheticDrive::Options options;
  /// In these nothing on the road tells how far off it is, so the only right status is held.
  std::optional<Frames> road_hidden;
};

/// The catalogue. Names are unique.
std::vector<HazardDrive> hazardDrives();

/// Throws OptionError that lists the names.
HazardDrive hazardDrive(const std::string& name);

/// How well the scale was measured on a drive whose truth is exact.
struct DriveFigures {
  std::size_t frames = 0;
  std::size_t tracked_frames = 0;
  std::size_t lost_events = 0;
  std::size_t metric_frames = 0;  ///< from the first metric pose on; shares are of these

  // Of the trajectory from the first metric pose on; NaN when there is none.
  double rle_percent = 0;
  double t_err_short_percent = 0;

  // ScaleMetrics' error_abs_median_percent, within_2_sigma and held_share, of kWayOfExactTruth.
  double scale_error_percent = 0;
  double within_2_sigma = 0;
  double held = 0;
  double ok_while_hidden = 0;  ///< share of road_hidden's frames with kOk; 0 when there are none
};

/// record: of the drive's own images, from the first on. Throws OptionError when it is shorter.
DriveFigures driveFigures(const HazardDrive& hazard, const SyntheticDrive& drive,
                          const RunRecord& record);

/// Renders the drive and runs both stages over it, frame by frame; options: without the camera's
/// height, which is the drive's. Throws OptionError.
RunRecord runDrive(const SyntheticDrive& drive, OfflineRun::Options options = {});

}  // namespace ground_scale_vo
