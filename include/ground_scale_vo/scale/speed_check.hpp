#pragma once

#include <cstdint>
#include <deque>
#include <string>

#include "ground_scale_vo/scale/speed_track.hpp"

namespace ground_scale_vo {

/// Compares the speeds with the motion of the odometry and names what is wrong with them. Nothing
/// is corrected by it: the gate of the scale filter decides which speeds are used.
class SpeedCheck {
 public:
  /// A piece of the path within one map.
  struct Piece {
    std::int64_t from_ns = 0, to_ns = 0;
    double metres = 0;      ///< signed, of the speeds
    double units = 0;       ///< of the odometry [VO units]
    double along_axis = 0;  ///< cosine between the motion and the optical axis
    double error = 0;       ///< ln of the speed by the scale
    bool accepted = false;  ///< by the filter
  };

  void add(const Piece& piece, const SpeedTrack& speeds);
  /// Another unit of length.
  void startMap() { pieces_.clear(); }

  /// One sentence, or empty. stamp_ns: of the newest image.
  std::string warning(const SpeedTrack& speeds, std::int64_t stamp_ns) const;

  /// [s] by which the stamps of the speeds are later than the motion; 0: not noticeable.
  double delay() const { return delay_; }

 private:
  void estimateDelay(const SpeedTrack& speeds);

  std::deque<Piece> pieces_;   ///< the latest of this map
  int rejected_ = 0;           ///< consecutive pieces
  double rejected_error_ = 0;  ///< of the newest one
  double sign_ = 0;            ///< mean of the sign of speed times motion along the axis
  int signed_pieces_ = 0;
  double delay_ = 0;
  std::int64_t delay_estimated_ns_ = 0;
};

}  // namespace ground_scale_vo
