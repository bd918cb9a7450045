#include "scale/speed_check.hpp"

#include <algorithm>
#include <cmath>

#include "common/text.hpp"
#include "common/time.hpp"

namespace ground_scale_vo {
namespace {

/// [s] Difference of the stamps of speeds and images that is no delay of a sensor any more.
constexpr double kOtherClock = 5;
constexpr int kMinRejected = 3;  ///< [pieces] consecutive ones, to be named
constexpr int kMinSignedPieces = 5;
constexpr double kMinAlongAxis = 0.5;  ///< of a camera that looks along or against the motion

constexpr double kHeightSigmas = 3;                       ///< of a deviation that is named
constexpr double kLeastHeight = 0.1, kLargestHeight = 4;  ///< [m] of a camera on a vehicle

// Delay.
constexpr double kMeanMemory = 5, kSumMemory = 60;  ///< [pieces]
constexpr double kMinPieces = 8;
constexpr double kMinDelay = 0.13;      ///< [s] that is named
constexpr double kMinSignificance = 4;  ///< [standard deviations]

}  // namespace

void SpeedCheck::add(const Piece& piece) {
  rejected_ = piece.accepted ? 0 : rejected_ + 1;
  rejected_error_ = piece.error;
  if (std::abs(piece.along_axis) > kMinAlongAxis) {
    ++signed_pieces_;
    sign_ += ((piece.along_axis > 0 ? 1 : -1) - sign_) / std::min(signed_pieces_, 20);
  }
  if (piece.accepted) estimateDelay(piece);
}

/// Speeds that are late by L [s] make the ratio too small by L times the relative acceleration.
/// Both are taken without their slow changes, because the unit of the odometry drifts.
void SpeedCheck::estimateDelay(const Piece& piece) {
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
  if (std::abs(slope) > std::max(kMinDelay, kMinSignificance * sigma)) delay_ = -slope;
}

std::string SpeedCheck::warning(const SpeedTrack& speeds, std::int64_t stamp_ns) const {
  if (speeds.empty()) return "no speed has arrived yet";
  const double ahead = secondsBetween(stamp_ns, speeds.newest().stamp_ns);
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
  if (speeds.jumped()) {
    return format("the speed jumps to %.2f m/s: wheel slip, or a sensor that fails",
                  speeds.newest().speed);
  }
  if (rejected_ >= kMinRejected && speeds.repeats()) {
    return format("the speed repeats %.2f m/s while the motion changes: the sensor is stuck",
                  speeds.newest().speed);
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

std::string heightWarning(double given, double given_sigma, const ScaleEstimate& scale) {
  const double sigma = std::max(given_sigma, scale.camera_height_sigma);
  if (given == 0) {
    const bool is_usual = scale.camera_height == 0 || (scale.camera_height > kLeastHeight &&
                                                       scale.camera_height < kLargestHeight);
    return is_usual ? ""
                    : format(
                          "the camera height is %.2f m by the speeds, which is unusual: "
                          "check their unit",
                          scale.camera_height);
  }
  if (std::abs(scale.camera_height - given) <= kHeightSigmas * sigma) return {};
  return format(
      "the camera height is given as %.2f +- %.2f m, but by the speeds it is %.2f +- %.2f m: "
      "check the mounting, the load and the unit of the speed",
      given, given_sigma, scale.camera_height, scale.camera_height_sigma);
}

}  // namespace ground_scale_vo
