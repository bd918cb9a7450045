#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Keeps map ids ascending when the odometry restarts and counts its maps from 0 again: its first
/// map then gets a new id. The rotation to that map is unknown, because a restarted odometry
/// describes only the motion since its own first image.
class MapNumbering {
 public:
  /// Renumbers the map of the next frame. A smaller sequence number means a restart; the same one
  /// is of an odometry that does not count its frames (SequenceCheck).
  void apply(VoFrame& frame) {
    if (last_sequence_ && frame.sequence < *last_sequence_) {
      offset_ = last_map_id_ + 1;
      if (continues_) first_after_restart_ = frame.map_id + offset_;
    }
    continues_ = true;
    last_sequence_ = frame.sequence;
    frame.map_id += offset_;
    last_map_id_ = frame.map_id;
    if (frame.map_id == first_after_restart_) {
      frame.map_start.rotation_sigma = std::numeric_limits<double>::infinity();
    }
  }

  /// A new trajectory starts with the next frame. If the odometry restarts there, too, the rotation
  /// since its first image is that since the start of the trajectory.
  void startTrajectory() {
    continues_ = false;
    first_after_restart_.reset();
  }

 private:
  std::optional<std::uint32_t> last_sequence_;
  std::uint32_t last_map_id_ = 0;
  std::uint32_t offset_ = 0;
  bool continues_ = false;                            ///< the trajectory contains the frames before
  std::optional<std::uint32_t> first_after_restart_;  ///< renumbered id
};

}  // namespace ground_scale_vo
