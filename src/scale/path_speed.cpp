#include "scale/path_speed.hpp"

#include <algorithm>
#include <cmath>

#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

constexpr double kZero = 0.02;           ///< [m/s] resolution of a sensor
constexpr double kLastBeforeStop = 2;    ///< [m/s] speed of the last sample before a stop, at most
constexpr double kTrackMemory = 120;     ///< [s]
constexpr double kMinJump = 1;           ///< [m/s]
constexpr double kMaxAcceleration = 12;  ///< [m/s^2]
constexpr double kMaxJumpTime = 4;       ///< [s]
/// [m/s^2] Standard deviation of the acceleration's change between two samples.
constexpr double kAccelerationSigma = 1;
constexpr std::size_t kMaxSamples = 20000;

double interpolate(const SpeedSample& a, const SpeedSample& b, std::int64_t stamp_ns) {
  const double share =
      static_cast<double>(stamp_ns - a.stamp_ns) / static_cast<double>(b.stamp_ns - a.stamp_ns);
  return a.speed + share * (b.speed - a.speed);
}

std::deque<SpeedSample>::const_iterator firstAfter(const std::deque<SpeedSample>& samples,
                                                   std::int64_t stamp_ns) {
  return std::upper_bound(
      samples.begin(), samples.end(), stamp_ns,
      [](std::int64_t stamp, const SpeedSample& sample) { return stamp < sample.stamp_ns; });
}

constexpr double kShortestInterval = 0.01;  ///< [s] between two images
/// [m] Apparent motion along the path, and its cosine, from which on a speed of zero is no stop.
constexpr double kMaxApparentMotion = 1, kAlongPath = 0.97;

// Pieces of the path.
constexpr double kMinFirstPiece = 1, kMinPiece = 3;  ///< [m] least length
constexpr double kMaxPieceTime = 10;                 ///< [s]
/// [m] How far the last piece may lie behind. A piece ends where the newest speed ends.
constexpr double kReach = 10;
/// Relative standard deviation of a piece's length in the odometry.
constexpr double kPieceNoise = 0.004;
/// Of a speed that repeats exactly.
constexpr double kRepeatedSpeedSigma = 0.03;
/// [m] In a turn the camera and the point whose speed is measured have different paths.
constexpr double kSpeedLever = 0.3;
constexpr double kStampSigma = 0.2;  ///< [s] standard deviation of the stamps
/// Mean age of a value that a sensor repeats, by the time over which it does.
constexpr double kHeldShare = 0.5;

/// [s] Difference of the stamps of speeds and images that is no delay of a sensor any more.
constexpr double kOtherClock = 5;
constexpr int kMinRejected = 3;  ///< [pieces] consecutive ones, to be named
constexpr int kMinSignedPieces = 5;
constexpr double kMinAlongAxis = 0.5;  ///< of a camera that looks along or against the motion

/// Of ln of a height and of a speed together, as they are measured on vehicles.
constexpr double kMaxHeightError = 0.07;
constexpr double kHeightSigmas = 3;                       ///< of a deviation that is named
constexpr double kLeastHeight = 0.2, kLargestHeight = 4;  ///< [m] of a camera on a vehicle

// Delay.
constexpr double kMeanMemory = 5, kSumMemory = 60;  ///< [pieces]
constexpr double kMinPieces = 8;
constexpr double kMinDelay = 0.13;      ///< [s] that is named
constexpr double kMinSignificance = 4;  ///< [standard deviations]
constexpr double kMinExplained = 0.75;  ///< share of the squared deviations of the pieces

}  // namespace

void SpeedTrack::add(const SpeedSample& sample) {
  if (!areFinite(sample.speed, sample.sigma)) return;
  if (std::abs(sample.speed) > kMaxVehicleSpeed) {
    ++out_of_range_;
    newest_out_of_range_ = sample.speed;
    return;
  }
  out_of_range_ = 0;
  newest_out_of_range_ = 0;
  if (!samples_.empty()) {
    const double dt = secondsBetween(newest_.stamp_ns, sample.stamp_ns);
    if (dt < -kMaxInterval) {
      *this = SpeedTrack(default_sigma_);
    } else if (dt <= 0) {
      return;
    }
  }
  const bool is_left_out = !samples_.empty() && updateJump(sample);
  if (!samples_.empty()) updateRuns(sample);
  newest_ = sample;
  has_moved_ = has_moved_ || std::abs(sample.speed) >= kZero;
  if (is_left_out) return;
  samples_.push_back(sample);
  if (!(sample.sigma > 0)) samples_.back().sigma = default_sigma_;
  while (samples_.size() > kMaxSamples ||
         secondsBetween(samples_.front().stamp_ns, sample.stamp_ns) > kTrackMemory) {
    samples_.pop_front();
  }
}

bool SpeedTrack::isZero() const { return !empty() && std::abs(newest_.speed) < kZero; }

/// From the newest sample: faster than any vehicle accelerates or brakes, also from a value that is
/// older than the sample, unless that is left out.
bool SpeedTrack::jumps(const SpeedSample& sample) const {
  const double dt = secondsBetween(newest_.stamp_ns, sample.stamp_ns) +
                    (jumped_ns_ ? 0 : std::min(run_s_, held_s_));
  return std::abs(sample.speed - newest_.speed) > kMinJump + kMaxAcceleration * dt;
}

/// Whether the sample is left out.
bool SpeedTrack::updateJump(const SpeedSample& sample) {
  if (!jumped_ns_) {
    if (jumps(sample)) jumped_ns_ = sample.stamp_ns;
  } else if (jumps(sample) || secondsBetween(*jumped_ns_, sample.stamp_ns) > kMaxJumpTime) {
    jumped_ns_.reset();
  }
  return jumped_ns_.has_value();
}

/// Runs of the same value, and of zeros.
void SpeedTrack::updateRuns(const SpeedSample& sample) {
  const double dt = secondsBetween(newest_.stamp_ns, sample.stamp_ns);
  const bool is_zero = std::abs(sample.speed) < kZero, was_zero = std::abs(newest_.speed) < kZero;
  const bool is_equal = sample.speed == newest_.speed, repeats = is_equal && !is_zero;
  has_varied_ = has_varied_ || (!is_equal && !is_zero && !was_zero);
  if (!is_equal && !was_zero) held_s_ = std::min(run_s_, kMinRepeatedTime);
  run_s_ = is_equal ? run_s_ + dt : 0;
  repeated_ = repeats ? repeated_ + 1 : 0;
  repeated_s_ = repeats ? repeated_s_ + dt : 0;
  if (!is_zero) {
    zero_is_stop_ = false;
  } else if (!was_zero) {
    zero_is_stop_ = dt <= kMaxInterval && !jumped_ns_ && std::abs(newest_.speed) < kLastBeforeStop;
  }
}

std::optional<double> SpeedTrack::distance(std::int64_t from_ns, std::int64_t to_ns,
                                           double* sigma) const {
  auto next = firstAfter(samples_, from_ns);
  if (next == samples_.begin() || !(from_ns < to_ns)) return std::nullopt;
  double metres = 0, variance = 0;
  for (auto previous = next - 1; previous->stamp_ns < to_ns; previous = next++) {
    if (next == samples_.end()) return std::nullopt;
    if (secondsBetween(previous->stamp_ns, next->stamp_ns) > kMaxInterval) return std::nullopt;
    const std::int64_t a_ns = std::max(from_ns, previous->stamp_ns);
    const std::int64_t b_ns = std::min(to_ns, next->stamp_ns);
    const double dt = secondsBetween(a_ns, b_ns);
    metres +=
        0.5 * dt * (interpolate(*previous, *next, a_ns) + interpolate(*previous, *next, b_ns));
    // The noise of the samples is white; one sample holds for the interval between two.
    const double interval = secondsBetween(previous->stamp_ns, next->stamp_ns);
    variance += next->sigma * next->sigma * dt * interval +
                std::pow(kAccelerationSigma * interval * dt / 12, 2);
  }
  *sigma = std::sqrt(variance);
  return metres;
}

double SpeedTrack::speedAt(std::int64_t stamp_ns) const {
  const auto next = firstAfter(samples_, stamp_ns);
  if (next == samples_.begin()) return next->speed;
  return next == samples_.end() ? samples_.back().speed : interpolate(*(next - 1), *next, stamp_ns);
}

bool SpeedTrack::standsStill(std::int64_t from_ns, std::int64_t to_ns) const {
  if (samples_.size() < 2 || !has_moved_) return false;
  // As far as the next sample is not due yet.
  const SpeedSample& newest = samples_.back();
  const double interval = secondsBetween(samples_[samples_.size() - 2].stamp_ns, newest.stamp_ns);
  if (secondsBetween(newest.stamp_ns, to_ns) > 1.2 * interval) return false;
  for (auto sample = samples_.rbegin(); sample != samples_.rend(); ++sample) {
    if (std::abs(sample->speed) >= kZero) return false;
    if (sample->stamp_ns <= from_ns) return zero_is_stop_;
  }
  return false;
}

void PathSpeed::startMap() {
  is_first_of_map_ = true;
  measured_ns_ = 0;
  accepted_length_.reset();
}

bool PathSpeed::standsStill(const CameraPath& path, const VoFrame& frame, double scale) {
  if (path.empty()) return false;
  const CameraPath::Pose& stop = path.newest();
  if (!speeds_.standsStill(stop.stamp_ns, frame.stamp_ns)) return false;
  const Eigen::Vector3d motion_c = (stop.T_w_c.inverse() * frame.T_w_c).translation();
  if (motion_c.norm() * scale < kMaxApparentMotion ||
      motion_c.normalized().dot(stop.prior.forward_c) < kAlongPath) {
    return true;
  }
  speeds_.ignoreZero();
  return false;
}

std::optional<PathSpeed::Piece> PathSpeed::measure(const CameraPath& path, double scale) {
  const auto& poses = path.poses();
  const auto covered = [&](std::int64_t stamp_ns) {
    return std::find_if(poses.rbegin(), poses.rend(),
                        [&](const CameraPath::Pose& pose) { return pose.stamp_ns <= stamp_ns; });
  };
  const auto to = covered(speeds_.samples().back().stamp_ns);
  if (to == poses.rend()) return std::nullopt;
  /// [VO units/s] over the step to a pose, or from the first one.
  const auto speedAt = [&](auto pose) {
    if (std::next(pose) == poses.rend()) --pose;
    const auto previous = std::next(pose);
    return (pose->travelled - previous->travelled) /
           std::max(kShortestInterval, secondsBetween(previous->stamp_ns, pose->stamp_ns));
  };
  auto from = covered(measured_ns_);
  if (from == poses.rend()) --from;
  if (from->stamp_ns >= to->stamp_ns) return std::nullopt;
  double distance_sigma = 0;
  const auto distance = speeds_.distance(from->stamp_ns, to->stamp_ns, &distance_sigma);
  if (!distance || secondsBetween(from->stamp_ns, to->stamp_ns) > kMaxPieceTime) {
    measured_ns_ = to->stamp_ns;  // a gap, or hardly any motion
    return std::nullopt;
  }
  const double metres = std::abs(*distance), units = to->travelled - from->travelled;
  const double min_metres = accepted_length_ ? kMinPiece : kMinFirstPiece;
  Piece piece;
  piece.has_failed = units * scale > 5 * std::max(metres, min_metres);
  if ((metres < min_metres && !piece.has_failed) || !(units > 0)) return std::nullopt;
  const Eigen::Isometry3d motion = from->T_w_c.inverse() * to->T_w_c;
  const double speed_change = speeds_.speedAt(to->stamp_ns) - speeds_.speedAt(from->stamp_ns);
  // By the change of the speed within the piece, the stamps matter. The odometry sees it in time.
  const double change =
      std::max(std::abs(speed_change), std::abs(speedAt(to) - speedAt(from)) * metres / units);
  const double sigma =
      std::hypot(distance_sigma, kSpeedLever * Eigen::AngleAxisd(motion.linear()).angle(),
                 std::hypot(kStampSigma, delay_, kHeldShare * speeds_.heldTime()) * change) /
      metres;
  piece.metres_per_unit = metres / units;
  piece.relative_sigma =
      std::hypot(sigma, kPieceNoise, speeds_.repeats() ? kRepeatedSpeedSigma : 0);
  piece.log_ratio = std::log((metres + 0.01) / units);
  piece.relative_acceleration = speed_change / *distance;
  piece.along_axis = std::copysign(1, *distance) * motion.translation().normalized().z();
  piece.error = scale > 0 ? std::log(std::max(metres, 1e-6) / units / scale) : 0;
  measured_ns_ = to->stamp_ns;
  return piece;
}

void PathSpeed::add(const Piece& piece, bool accepted, const CameraPath& path) {
  rejected_ = accepted ? 0 : rejected_ + 1;
  rejected_error_ = piece.error;
  const std::string mistake = accepted ? "" : unitMistake(std::exp(piece.error));
  unit_mistakes_ = mistake.empty() ? 0 : mistake == unit_mistake_ ? unit_mistakes_ + 1 : 1;
  unit_mistake_ = mistake;
  if (std::abs(piece.along_axis) > kMinAlongAxis) {
    ++signed_pieces_;
    sign_ += ((piece.along_axis > 0 ? 1 : -1) - sign_) / std::min(signed_pieces_, 20);
  }
  if (accepted) estimateDelay(piece);
  speeds_.setAgrees(accepted);
  accepted_length_ = accepted ? std::optional(path.newest().travelled) : std::nullopt;
}

bool PathSpeed::isCurrent(const CameraPath& path, double scale) const {
  return accepted_length_ && scale > 0 &&
         (path.newest().travelled - *accepted_length_) * scale < kReach;
}

/// Speeds that are late by L [s] make the ratio too small by L times the relative acceleration.
/// Both are taken without their slow changes, because the unit of the odometry drifts.
void PathSpeed::estimateDelay(const Piece& piece) {
  if (is_first_of_map_) {
    is_first_of_map_ = false;
    mean_ratio_ = piece.log_ratio;
    mean_acceleration_ = piece.relative_acceleration;
    return;
  }
  const double ratio = piece.log_ratio - mean_ratio_;
  const double acceleration = piece.relative_acceleration - mean_acceleration_;
  mean_ratio_ += ratio / kMeanMemory;
  mean_acceleration_ += acceleration / kMeanMemory;
  const double kept = 1 - 1 / kSumMemory;
  pieces_ = kept * pieces_ + 1;
  ratio_squares_ = kept * ratio_squares_ + ratio * ratio;
  acceleration_squares_ = kept * acceleration_squares_ + acceleration * acceleration;
  products_ = kept * products_ + ratio * acceleration;
  delay_ = 0;
  if (pieces_ < kMinPieces || !(acceleration_squares_ > 0)) return;
  const double slope = products_ / acceleration_squares_;
  const double residual = std::max(0.0, ratio_squares_ - slope * products_) / pieces_;
  const double sigma = std::sqrt(residual / acceleration_squares_);
  // Most of the deviations must follow the acceleration: a unit that drifts while the vehicle
  // starts is no delay.
  if (slope * products_ < kMinExplained * ratio_squares_) return;
  if (std::abs(slope) > std::max(kMinDelay + speeds_.heldTime(), kMinSignificance * sigma)) {
    delay_ = -slope;
  }
}

std::string PathSpeed::error() const {
  if (speeds_.isOutOfRange()) {
    return format("the speed is %.0f m/s, outside -%.0f to %.0f m/s: is its unit m/s?",
                  speeds_.newestOutOfRange(), kMaxVehicleSpeed, kMaxVehicleSpeed);
  }
  if (unit_mistakes_ < kMinRejected) return "";
  return format(
      "the speed is %.3g times that of the odometry with the given camera height: it looks like %s",
      std::exp(rejected_error_), unit_mistake_.c_str());
}

std::string PathSpeed::warning(std::int64_t stamp_ns) const {
  if (speeds_.newestOutOfRange() != 0) {
    return format("the speed %.0f m/s is outside -%.0f to %.0f m/s and not used",
                  speeds_.newestOutOfRange(), kMaxVehicleSpeed, kMaxVehicleSpeed);
  }
  if (speeds_.empty()) return "no speed has arrived yet";
  const double ahead = secondsBetween(stamp_ns, speeds_.newest().stamp_ns);
  if (std::abs(ahead) > kOtherClock) {
    return ahead > 0
               ? format(
                     "the newest speed is %.1f s later than the images: its clock is another one",
                     ahead)
               : format(
                     "the newest speed is %.1f s earlier than the images: the sensor is silent, or "
                     "its clock is another one",
                     -ahead);
  }
  if (speeds_.jumped()) {
    return format("the speed jumps to %.2f m/s: wheel slip, or a sensor that fails",
                  speeds_.newest().speed);
  }
  if (!speeds_.hasVaried() && speeds_.repeats()) {
    return format("the speed has been %.2f m/s from the start: it is not used until it changes",
                  speeds_.newest().speed);
  }
  if (rejected_ >= kMinRejected && speeds_.repeats()) {
    return format("the speed repeats %.2f m/s while the motion changes: the sensor is stuck",
                  speeds_.newest().speed);
  }
  if (rejected_ >= kMinRejected) {
    return format("the speed is %.0f %% %s than the odometry's: wheel slip, or another unit",
                  100 * std::abs(std::expm1(rejected_error_)),
                  rejected_error_ > 0 ? "higher" : "lower");
  }
  if (delay_ != 0) {
    return format(
        "the speeds are %.2f s %s than the motion in the images: their stamps are not "
        "those of the measurement",
        std::abs(delay_), delay_ > 0 ? "later" : "earlier");
  }
  if (signed_pieces_ >= kMinSignedPieces && sign_ < -0.5) {
    return "the sign of the speed is opposite to the motion along the optical axis, as for a "
           "camera that looks backwards: only its absolute value is used";
  }
  return "";
}

std::string heightError(double given, double given_sigma, double learned) {
  if (learned == 0) return "";
  if (given > 0) {
    const double limit = std::max(kMaxHeightError, kHeightSigmas * given_sigma / given);
    const std::string mistake = unitMistake(learned / given);
    if (mistake.empty() && std::abs(std::log(learned / given)) < limit) return "";
    return format("the camera height is given as %.2f m, but by the speeds it is %.2f m: ", given,
                  learned) +
           (mistake.empty() ? "one of them is wrong" : "their unit looks like " + mistake);
  }
  const auto isUsual = [](double height) {
    return height >= kLeastHeight && height <= kLargestHeight;
  };
  if (isUsual(learned)) return "";
  std::string units;
  for (const SpeedUnit& unit : kSpeedUnits) {
    const double factor =
        learned > kLargestHeight ? unit.metres_per_second : 1 / unit.metres_per_second;
    if (!isUsual(learned * factor)) continue;
    units += format("%s %s (%.2f m)", units.empty() ? "" : " or", unit.symbol, learned * factor);
  }
  return format("the camera height is %.2f m by the speeds, outside %.1f to %.0f m", learned,
                kLeastHeight, kLargestHeight) +
         (units.empty() ? ": check their unit"
                        : (learned > kLargestHeight ? ": their unit looks like"
                                                    : ": they look like m/s taken as") +
                              units);
}

std::string heightWarning(double given, double given_sigma, const ScaleEstimate& scale) {
  const double sigma = std::max(given_sigma, scale.camera_height_sigma);
  if (given == 0) return "";
  if (std::abs(scale.camera_height - given) <= kHeightSigmas * sigma) return {};
  return format(
      "the camera height is given as %.2f +- %.2f m, but by the speeds it is %.2f +- %.2f m: "
      "check the mounting, the load and the unit of the speed",
      given, given_sigma, scale.camera_height, scale.camera_height_sigma);
}

}  // namespace gsv
