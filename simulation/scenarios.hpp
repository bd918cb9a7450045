#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "simulation/image_faults.hpp"
#include "simulation/synthetic_drive.hpp"

namespace gsv {

// A setting is a string "option=value", see setOption().

/// The scale from the feature-based plane only, or from the direct plane only: the feature-based
/// estimate fails when more ground points are required than a frame has.
constexpr const char* kFeatureBasedOnly = "refine=false";
constexpr const char* kDirectOnly = "gpe/min_points=1000000";

/// The component that a scenario depends on, and settings that demonstrate it.
struct ScenarioAblation {
  std::string component;             ///< one line; empty: none is decisive alone
  std::vector<std::string> base;     ///< with these settings the thresholds are met
  std::vector<std::string> disable;  ///< with `base` and these, one is violated; empty: not known
};

/// Thresholds of a run over a scenario.
struct ScenarioThresholds {
  double max_rle_percent = 1.5;
  /// An alternative to max_rle_percent, for drives of which a part cannot be measured accurately
  /// (black images, hardly any visible road, asphalt without texture): the displacement error in
  /// published sigmas. 0: no alternative.
  double max_displacement_sigmas = 0;
  double max_rotation_error_deg = 2;
  /// Frames without a pose of the odometry. Above 0, the odometry may also lose track.
  std::size_t max_untracked_frames = 0;
  /// Below 0.95: the errors of neighbouring frames are correlated, so the share varies widely over
  /// a short drive.
  double min_within_2_sigma = 0.75;
  double max_ok_while_unobservable = 0;  ///< share of the frames in which it is unobservable
  /// The share of frames from the first metric pose on must exceed this.
  double min_metric_share = 0.5;
  double max_error_after_fault_percent = 5;
};

/// A short rendered drive with one property that makes the scale difficult to measure.
struct Scenario {
  std::string name;         ///< lower case, words joined by _
  std::string description;  ///< one line
  SyntheticDrive::Options options;
  /// Frames in which the height over the road is not observable (no texture, hidden road, or
  /// standstill), so the scale must not be reported as measured.
  FrameRange unobservable;
  /// Frames with a fault of the image, or in which an obstacle hides the road. The reaction to it
  /// is evaluated.
  FrameRange fault;
  ScenarioAblation ablation;
  ScenarioThresholds thresholds;
};

/// The catalogue, without the faults. Names are unique.
std::vector<Scenario> allScenarios();

/// One drive for each fault of the camera, and two with an obstacle that hides the road. Names
/// begin with "fault_".
std::vector<Scenario> faultScenarios();

/// A scenario of either list. Throws OptionError, which lists the names, if there is none.
Scenario findScenario(const std::string& name);

}  // namespace gsv
