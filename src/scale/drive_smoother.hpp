#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "scale/path_speed.hpp"
#include "scale/scale_filter.hpp"

namespace gsv {

/// Records a drive, and gives each of its frames the scale that follows from all measurements, also
/// later ones: a Rauch-Tung-Striebel smoother over the states of ScaleFilter, and the trajectory
/// with its scales.
class DriveSmoother {
 public:
  using Smoothed = ScaleRecovery::Smoothed;

  void startMap() { starts_map_ = true; }
  /// After the updates of a frame.
  void addStep(const ScaleFilter& filter);
  void addSpeed(const SpeedSample& speed) { new_speeds_.push_back(speed); }
  /// frame, continuity, scale and speeds: as the trajectory got them.
  void addFrame(const VoFrame& frame, Continuity continuity, const ScaleEstimate& scale,
                const SpeedTrack& speeds);

  /// Of all frames so far.
  std::vector<Smoothed> smoothed(const ScaleRecoveryOptions& options) const;

 private:
  /// The filter at one frame.
  struct Step {
    HeightState predicted, filtered;
    double distance;  ///< travelled in the map [VO units]
    double nis_scale;
    bool has_height, has_scale;
    bool starts_chain;  ///< its height does not follow from that of the step before
  };
  struct Frame {
    VoFrame vo;  ///< without features
    Continuity continuity;
    ScaleEstimate scale;
    std::vector<SpeedSample> speeds;  ///< that arrived since the frame before
    bool speeds_agree, zero_is_stop;
    std::size_t steps;  ///< so far
    std::size_t map;
  };

  std::vector<Step> smoothedSteps() const;

  std::vector<Step> steps_;
  std::vector<std::size_t> map_starts_;  ///< number of steps at the start of each map
  std::vector<Frame> frames_;
  std::vector<SpeedSample> new_speeds_;
  bool starts_map_ = true;
};

}  // namespace gsv
