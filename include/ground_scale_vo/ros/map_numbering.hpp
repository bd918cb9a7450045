#pragma once

#include <cstdint>
#include <optional>

#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// Keeps map ids ascending when the odometry restarts and counts its maps from 0 again: its first
/// map then gets a new id.
class MapNumbering {
 public:
  /// Renumbers the map of the next frame. A smaller sequence number means a restart; the same one
  /// is of an odometry that does not count its frames (SequenceCheck).
  void apply(VoFrame& frame) {
    if (last_sequence_ && frame.sequence < *last_sequence_) offset_ = last_map_id_ + 1;
    last_sequence_ = frame.sequence;
    frame.map_id += offset_;
    last_map_id_ = frame.map_id;
  }

 private:
  std::optional<std::uint32_t> last_sequence_;
  std::uint32_t last_map_id_ = 0;
  std::uint32_t offset_ = 0;
};

}  // namespace ground_scale_vo
