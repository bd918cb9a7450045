#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "ground_scale_vo/evaluation/run_record.hpp"

namespace ground_scale_vo {

/// The metric trajectory of a run at any stamp, and where in it the scale was measured.
class InterpolatedTrack {
 public:
  /// frames must outlive the track.
  explicit InterpolatedTrack(const std::vector<RunFrame>& frames);

  struct Position {
    std::size_t frame = 0;                        ///< index of the last frame up to the stamp
    Eigen::Vector3d p = Eigen::Vector3d::Zero();  ///< [m]
  };

  /// Linear between two frames of one map with metric poses. Empty where there are none.
  std::optional<Position> at(std::int64_t stamp_ns) const;

  /// All frames from first to last have a metric pose in one map.
  bool isUnbroken(std::size_t first, std::size_t last) const;

  /// At least half of the moving frames from first to last measured the scale.
  bool isMeasured(std::size_t first, std::size_t last) const;

 private:
  const std::vector<RunFrame>& frames_;
  std::vector<int> measured_, moving_;  ///< counts of the frames before frame i
};

}  // namespace ground_scale_vo
