#pragma once

#include <cstdint>
#include <string>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "scale/speed_track.hpp"

namespace ground_scale_vo {

/// Compares the speeds with the motion of the odometry and names what is wrong with them. It
/// corrects nothing: SpeedTrack and the gate of the scale filter decide which speeds are used.
class SpeedCheck {
 public:
  /// A piece of the path within one map.
  struct Piece {
    double log_ratio = 0;  ///< ln of the distance [m] by that of the odometry [VO units]
    double relative_acceleration = 0;  ///< mean of the change of ln of the speed [1/s]
    double along_axis = 0;  ///< cosine between the motion and the optical axis; < 0: speed opposite
    double error = 0;       ///< ln of the speed by the filter's scale
    bool accepted = false;  ///< by the filter
  };

  void add(const Piece& piece);
  /// Another unit of length.
  void startMap() { is_first_of_map_ = true; }

  /// One sentence, or empty. stamp_ns: of the newest image.
  std::string warning(const SpeedTrack& speeds, std::int64_t stamp_ns) const;

  /// [s] by which the stamps of the speeds are later than the motion; 0: not noticeable.
  double delay() const { return delay_; }

 private:
  void estimateDelay(const Piece& piece);

  int rejected_ = 0;           ///< consecutive pieces
  double rejected_error_ = 0;  ///< of the newest one
  double sign_ = 0;            ///< mean of the sign of along_axis
  int signed_pieces_ = 0;
  double delay_ = 0;
  // Of the pieces so far, with more weight on the latest: means, and sums of the deviations.
  bool is_first_of_map_ = true;
  double mean_ratio_ = 0, mean_acceleration_ = 0;
  double pieces_ = 0, ratio_squares_ = 0, acceleration_squares_ = 0, products_ = 0;
};

/// One sentence with both heights if the one that speeds have taught deviates from the given one
/// [m] by more than three standard deviations of either; or, if none was given (0), is not that of
/// a vehicle. Empty: neither.
std::string heightWarning(double given, double given_sigma, const ScaleEstimate& scale);

}  // namespace ground_scale_vo
