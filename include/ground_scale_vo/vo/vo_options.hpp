#pragma once

#include "ground_scale_vo/common/options.hpp"

namespace gsv {

/// Options of VisualOdometry. Its other parameters are constants beside the code that uses them.
struct OdometryOptions {
  double cell_size = 0.0129;
  double min_corner_strength = 1e-4;
  double min_corner_ratio = 0.12;
  double min_correlation = 0.8;
  int adjusted_keyframes = 7;
  double standstill_flow = 0.0003;
  double readout_time = 0;

  template <typename Self, typename Visit>
  static void visitParameters(Self& self, Visit&& visit) {
    visit("tracker/cell_size", self.cell_size, 0.004, 0.2,
          "[image width] side of the grid cells, at least 8 px; each holds at most one new corner");
    visit("tracker/min_corner_strength", self.min_corner_strength, 0, 1,
          "[] smaller eigenvalue of the gradient matrix, grey levels in [0, 1]");
    visit("tracker/min_corner_ratio", self.min_corner_ratio, 0, 1,
          "[] smaller over larger eigenvalue; a corner with less lies on an edge");
    visit("alignment/min_correlation", self.min_correlation, 0, 1,
          "[] least normalised correlation of an aligned patch");
    visit("bundle_adjustment/window", self.adjusted_keyframes, 1, 100,
          "[keyframes] newest ones that are optimised; older ones are fixed");
    visit("odometry/standstill_flow", self.standstill_flow, 0, 0.1,
          "[image width] median flow below which the camera stands still");
    visit("odometry/readout_time", self.readout_time, 0, 0.2,
          "[s] of a rolling shutter, from the exposure of the first row to that of the last one; "
          "stamps are those of the middle row; 0: global shutter");
  }
  template <typename Self, typename Visit>
  static void visitStages(Self& self, Visit&& visit) {
    visit("", self);
  }
  /// Throws OptionError.
  void validate() const { requireInRanges(*this); }
};

}  // namespace gsv
