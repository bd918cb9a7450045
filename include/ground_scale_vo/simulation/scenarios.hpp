#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "ground_scale_vo/simulation/synthetic_drive.hpp"

namespace ground_scale_vo {

// Settings are assignments of options, as in setOption().

/// Restricts the scale to one of its two sources.
constexpr const char* kFeatureBasedOnly = "refine=false";
constexpr const char* kDirectOnly = "gpe/min_points=1000000";  ///< more than a frame has

/// The component that a scenario depends on, and settings that demonstrate it.
struct ScenarioAblation {
  std::string component;             ///< one line; empty: no single one
  std::vector<std::string> base;     ///< with these settings the thresholds are met
  std::vector<std::string> disable;  ///< with these in addition one is violated; empty: unknown
};

/// Thresholds of a run over a scenario.
struct ScenarioThresholds {
  double max_rle_percent = 1.5;
  /// Below 0.95, because the errors of neighbouring frames are correlated.
  double min_within_2_sigma = 0.75;
  double max_ok_while_unobservable = 0;
  double min_metric_share = 0.5;  ///< of the frames; exclusive
};

/// A short rendered drive with one property that makes the scale difficult to measure.
struct Scenario {
  /// Frames [first, last].
  struct FrameRange {
    std::size_t first, last;
  };

  std::string name;         ///< lower case, words joined by _
  std::string description;  ///< one line
  SyntheticDrive::Options options;
  /// Frames in which the height over the road is not observable (no texture, or standstill), so the
  /// scale must be reported as held.
  std::optional<FrameRange> unobservable;
  ScenarioAblation ablation;
  ScenarioThresholds thresholds;
};

/// The catalogue. Names are unique.
std::vector<Scenario> allScenarios();

/// Throws OptionError with a list of the names.
Scenario findScenario(const std::string& name);

}  // namespace ground_scale_vo
