#pragma once

#include <cstddef>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {

/// The scale from one of its two sources, as an assignment (setOption).
constexpr const char* kFeatureBasedOnly = "refine=false";
constexpr const char* kDirectOnly = "gpe/min_points=1000000";  ///< out of reach

/// What makes a drive right, and the options (as of setOption) by which it can be shown.
struct ScenarioAblation {
  std::string what;                  ///< one line; empty: no single thing
  std::vector<std::string> with;     ///< besides the defaults: so set, the drive keeps its bars
  std::vector<std::string> without;  ///< besides those: so set, it breaks one. Empty: none is known
};

/// What a drive keeps when it is measured.
struct DriveThresholds {
  double rle_percent = 1.5;      ///< at most
  double within_2_sigma = 0.75;  ///< at least; neighbouring frames err together, so not 0.95
  double ok_while_hidden = 0;    ///< at most
  double metric_share = 0.5;     ///< of the frames; more
};

/// A short rendered drive with one thing in it that makes the scale hard to measure.
struct Scenario {
  /// Frames [first, last].
  struct Frames {
    std::size_t first, last;
  };

  std::string name;  ///< lower case, words joined by _
  std::string what;  ///< one line
  SyntheticDrive::Options options;
  /// In these nothing tells how far off the road is (bare, or the camera stands), so the only right
  /// status is held.
  std::optional<Frames> road_hidden;
  ScenarioAblation remedy;
  DriveThresholds bars;
};

/// The catalogue. Names are unique.
std::vector<Scenario> allScenarios();

/// Throws OptionError that lists the names.
Scenario findScenario(const std::string& name);

/// How well the scale was measured on a drive whose truth is exact.
struct DriveFigures {
  std::size_t frames = 0;
  std::size_t tracked_frames = 0;
  std::size_t lost_events = 0;
  std::size_t metric_frames = 0;  ///< from the first metric pose on; shares are of these

  // Of the trajectory from the first metric pose on; NaN when there is none.
  double rle_percent = 0;
  double t_err_short_percent = 0;

  // ScaleMetrics' error_abs_median_percent, within_2_sigma and held_share, of
  // kExactGroundTruthDistance.
  double scale_error_percent = 0;
  double within_2_sigma = 0;
  double held = 0;
  double ok_while_hidden = 0;  ///< share of road_hidden's frames with kOk; 0 when there are none
};

/// The first bar that the figures break, in a word: "lost" (not every frame is tracked), "start"
/// (metric in too few of them), "RLE", "2 sigma", "ok hidden". Empty: none.
std::string violatedThreshold(const DriveFigures& figures, const DriveThresholds& bars);

/// record: of the drive's own images, from the first on. Throws OptionError when it is shorter.
DriveFigures driveFigures(const Scenario& scenario, const SyntheticDrive& drive,
                          const RunRecord& record);

/// All images of the drive. each: is called after every one, may be empty.
std::vector<cv::Mat> renderDrive(const SyntheticDrive& drive,
                                 const std::function<void()>& each = {});

/// Runs both stages over the drive's images, frame by frame, with the defaults but for the drive's
/// camera height and these assignments (as of setOption). each: is called after every frame, may be
/// empty. Throws OptionError.
RunRecord runDrive(const SyntheticDrive& drive, const std::vector<cv::Mat>& images,
                   const std::vector<std::string>& assignments = {},
                   const std::function<void()>& each = {});

}  // namespace ground_scale_vo
