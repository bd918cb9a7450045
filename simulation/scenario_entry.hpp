#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "simulation/scenarios.hpp"

namespace gsv::simulation {

/// An entry of the catalogue: a drive without a stop, with the options that `configure` changes.
class Entry {
 public:
  Entry(const char* name, const char* description, int frames,
        const std::function<void(SyntheticDrive::Options&)>& configure) {
    scenario_.name = name;
    scenario_.description = description;
    scenario_.options.frames = frames;
    scenario_.options.stop_s = 0;
    configure(scenario_.options);
  }
  /// See ScenarioAblation.
  Entry& dependsOn(const char* component, std::vector<std::string> base,
                   std::vector<std::string> disable) {
    scenario_.ablation = {component, std::move(base), std::move(disable)};
    return *this;
  }
  Entry& unobservableFrames(std::size_t first, std::size_t last) {
    scenario_.unobservable = {first, last};
    return *this;
  }
  /// Sets a threshold other than the default.
  Entry& threshold(double ScenarioThresholds::*which, double value) {
    scenario_.thresholds.*which = value;
    return *this;
  }
  Entry& fault(const FrameRange& frames) {
    scenario_.fault = frames;
    return *this;
  }
  Entry& imageFault(FaultKind kind, std::size_t first, std::size_t count) {
    scenario_.options.faults = {{kind, {first, first + count - 1}}};
    return fault(scenario_.options.faults.front().frames);
  }
  /// During the fault the road is not visible: the scale is not measured after 3 s, and the
  /// odometry may lose track. Until a new map starts, three more frames may have no pose.
  Entry& hidesTheRoad() {
    const FrameRange& frames = scenario_.fault;
    const auto delay = static_cast<std::size_t>(3 * scenario_.options.frame_rate_hz);
    scenario_.unobservable = {frames.first + delay, frames.last};
    scenario_.thresholds.max_untracked_frames = frames.last - frames.first + 4;
    return threshold(&ScenarioThresholds::max_displacement_sigmas, 2);
  }
  operator Scenario() const { return scenario_; }

 private:
  Scenario scenario_;
};

inline void setCamera(SyntheticDrive::Options& o, int width, int height, double focal) {
  o.camera.width = width;
  o.camera.height = height;
  o.camera.fx = o.camera.fy = focal;
  o.camera.cx = (width - 1) / 2.0;
  o.camera.cy = (height - 1) / 2.0;
}

/// KITTI's field of view at 480x150: a third of the pixels of the default camera.
inline void setSmallCamera(SyntheticDrive::Options& o) { setCamera(o, 480, 150, 278); }

}  // namespace gsv::simulation
