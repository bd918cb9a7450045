#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/speed.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/camera_path.hpp"

namespace gsv {

/// The speeds of the last minutes, and the distances that follow from them. Between two samples the
/// speed is interpolated linearly. Samples from a jump that no vehicle makes (a wheel that slips or
/// locks, a sensor that fails) to the jump back are left out; a new level counts after a
/// while.
class SpeedTrack {
 public:
  /// [s] Longest interval between two samples without a gap; also how far the newest one reaches.
  static constexpr double kMaxInterval = 2.5;

  /// sigma: of a sample that has none [m/s].
  explicit SpeedTrack(double sigma) : default_sigma_(sigma) {}

  /// Adds a sample. Ignored: not finite, implausibly fast, or not later than the newest one; a
  /// stamp more than kMaxInterval before the newest one starts anew (the clock was set back).
  void add(const SpeedSample& sample);

  /// [m] Travelled between two stamps, signed: back and forth cancel each other. Empty when samples
  /// do not cover the time, or there is a gap. sigma: standard deviation [m] from the noise of the
  /// samples.
  std::optional<double> distance(std::int64_t from_ns, std::int64_t to_ns, double* sigma) const;

  /// [m/s] Interpolated; of the nearest sample outside their time. Precondition: not empty.
  double speedAt(std::int64_t stamp_ns) const;

  /// Whether the vehicle has stood still since from_ns: the sensor has been zero since then,
  /// reaches up to to_ns, and slowed down before. A sensor that jumps to zero, or has never been
  /// anything else, is taken to have failed.
  bool standsStill(std::int64_t from_ns, std::int64_t to_ns) const;
  bool isZero() const;  ///< the newest sample; false when there is none
  /// The vehicle moves although the newest samples are zero: they are no stop.
  void ignoreZero() { zero_is_stop_ = false; }
  bool zeroIsStop() const { return zero_is_stop_; }

  /// Whether the newest samples repeat one value other than zero for so long that the sensor may be
  /// stuck.
  bool repeats() const { return repeated_ >= kMinRepeated && repeated_s_ > kMinRepeatedTime; }

  /// Whether a moving vehicle has had two speeds: a sensor may be stuck from the start.
  bool hasVaried() const { return has_varied_; }

  /// Whether the latest speeds agree with the motion of the odometry, as its user has found. Those
  /// that do not are of no use where the odometry has no pose.
  bool agrees() const { return agrees_; }
  void setAgrees(bool agrees) { agrees_ = agrees; }

  /// [s] Over which the sensor repeats a value, by the last run of equal ones that has ended, up to
  /// kMinRepeatedTime: the speed may be that much older than its stamp.
  double heldTime() const { return held_s_; }
  /// The newest speeds are faster than any vehicle, and none before was one of a vehicle that
  /// moves.
  bool isOutOfRange() const { return out_of_range_ >= kMinOutOfRange && !has_moved_; }
  double newestOutOfRange() const { return newest_out_of_range_; }  ///< [m/s]; 0: there is none

  bool empty() const { return samples_.empty(); }
  const SpeedSample& newest() const { return newest_; }   ///< also one that is left out
  bool jumped() const { return jumped_ns_.has_value(); }  ///< the newest one is left out
  const std::deque<SpeedSample>& samples() const { return samples_; }

 private:
  static constexpr int kMinRepeated = 5;           ///< [samples]
  static constexpr double kMinRepeatedTime = 1.5;  ///< [s]
  static constexpr int kMinOutOfRange = 3;         ///< [samples]

  bool jumps(const SpeedSample& sample) const;
  bool updateJump(const SpeedSample& sample);
  void updateRuns(const SpeedSample& sample);

  double default_sigma_;
  bool agrees_ = false;
  SpeedSample newest_;                     ///< also one that is left out
  std::optional<std::int64_t> jumped_ns_;  ///< samples are left out since then
  std::deque<SpeedSample> samples_;        ///< in order of the stamps
  int repeated_ = 0;                       ///< [samples] with the value of the newest one
  double repeated_s_ = 0;
  double run_s_ = 0;      ///< [s] since the first of the newest samples with one value, also zero
  double held_s_ = 0;     ///< heldTime()
  int out_of_range_ = 0;  ///< consecutive samples
  double newest_out_of_range_ = 0;
  bool has_moved_ = false;  ///< any sample was not zero
  bool has_varied_ = false;
  bool zero_is_stop_ = false;  ///< the newest sample is zero, and the speed before was low
};

/// Compares the path of the odometry with the speeds of the vehicle: pieces of the path measure the
/// scale, and tell what is wrong with the speeds.
class PathSpeed {
 public:
  /// A piece of the path within one map.
  struct Piece {
    double metres_per_unit = 0;        ///< distance by the speeds over that of the odometry
    double relative_sigma = 0;         ///< of metres_per_unit
    bool has_failed = false;           ///< the odometry moves while the speeds stand still
    double log_ratio = 0;              ///< ln of metres_per_unit, finite also at standstill
    double relative_acceleration = 0;  ///< mean of the change of ln of the speed [1/s]
    double along_axis = 0;  ///< cosine between the motion and the optical axis; < 0: speed opposite
    double error = 0;       ///< ln of the speed by the filter's scale
  };

  /// sigma: of a speed that has none [m/s].
  explicit PathSpeed(double sigma) : speeds_(sigma) {}

  const SpeedTrack& speeds() const { return speeds_; }
  void add(const SpeedSample& speed) { speeds_.add(speed); }
  /// Another unit of length.
  void startMap();

  /// Whether the speeds say that the vehicle stands since the newest pose of the path. What then
  /// moves in the images is traffic, unless the motion is straight along the path. scale: [m per VO
  /// unit], 0: not known.
  bool standsStill(const CameraPath& path, const VoFrame& frame, double scale);

  /// The latest piece of the path that the speeds cover; empty while it is too short. Nothing waits
  /// for a speed: what arrives late measures an earlier piece. Precondition: the path is not empty.
  std::optional<Piece> measure(const CameraPath& path, double scale);
  /// Whether the filter accepted the piece of measure().
  void add(const Piece& piece, bool accepted, const CameraPath& path);

  /// The last piece was accepted, and is not far behind.
  bool isCurrent(const CameraPath& path, double scale) const;
  /// Why the speeds cannot be used at all, one sentence that names their unit, or empty.
  std::string error() const;
  /// What is wrong with the speeds, one sentence, or empty. stamp_ns: of the newest image.
  std::string warning(std::int64_t stamp_ns) const;

 private:
  void estimateDelay(const Piece& piece);

  SpeedTrack speeds_;
  std::int64_t measured_ns_ = 0;  ///< end of the last piece
  /// Length of the path at the last piece [VO units]; empty: it was not accepted.
  std::optional<double> accepted_length_;
  int rejected_ = 0;           ///< consecutive pieces
  double rejected_error_ = 0;  ///< of the newest one
  std::string unit_mistake_;   ///< of the newest one: unitMistake()
  int unit_mistakes_ = 0;      ///< consecutive pieces with the same
  double sign_ = 0;            ///< mean of the sign of along_axis
  int signed_pieces_ = 0;
  /// [s] by which the stamps of the speeds are later than the motion; 0: not noticeable.
  double delay_ = 0;
  // Of the pieces so far, with more weight on the latest: means, and sums of the deviations.
  bool is_first_of_map_ = true;
  double mean_ratio_ = 0, mean_acceleration_ = 0;
  double pieces_ = 0, ratio_squares_ = 0, acceleration_squares_ = 0, products_ = 0;
};

/// One sentence, which names the unit where it fits, if the camera height by the speeds [m] is that
/// of no camera on a vehicle, or contradicts the given one [m], whose standard deviation may be
/// infinite: only the factor of a unit does then. Empty: neither. 0: not known.
std::string heightError(double given, double given_sigma, double learned);
/// One sentence with both heights if the one by the speeds deviates from the given one [m] by more
/// than three standard deviations of either. Empty: none is given, or it does not.
std::string heightWarning(double given, double given_sigma, const ScaleEstimate& scale);

}  // namespace gsv
