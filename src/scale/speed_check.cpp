#include "ground_scale_vo/scale/speed_check.hpp"

#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "ground_scale_vo/common/text.hpp"
#include "ground_scale_vo/common/time.hpp"

namespace ground_scale_vo {
namespace {

/// [s] Difference of the stamps of speeds and images that is no delay of a sensor any more.
constexpr double kOtherClock = 5;
constexpr int kMinRejected = 3;  ///< [pieces] consecutive ones, to be named
constexpr int kMinSignedPieces = 5;
constexpr double kMinAlongAxis = 0.5;  ///< of a camera that looks along or against the motion

// Delay: the shift of the speeds that explains the motion best.
constexpr double kMemory = 30;                        ///< [s]
constexpr double kPeriod = 2;                         ///< [s] between two estimates
constexpr double kMaxDelay = 0.6, kDelayStep = 0.05;  ///< [s]
constexpr double kMinDelay = 0.1;                     ///< [s] that is named
constexpr std::size_t kMinPieces = 8;
constexpr double kMinResidual = 0.005;     ///< of the distance, without a shift
constexpr double kMaxResidualRatio = 0.5;  ///< with the best shift to without one

}  // namespace

void SpeedCheck::add(const Piece& piece, const SpeedTrack& speeds) {
  rejected_ = piece.accepted ? 0 : rejected_ + 1;
  rejected_error_ = piece.error;
  if (std::abs(piece.along_axis) > kMinAlongAxis) {
    const double sign = piece.along_axis * piece.metres > 0 ? 1 : -1;
    ++signed_pieces_;
    sign_ += (sign - sign_) / std::min(signed_pieces_, 4 * kMinSignedPieces);
  }
  pieces_.push_back(piece);
  while (secondsBetween(pieces_.front().to_ns, piece.to_ns) > kMemory) pieces_.pop_front();
  if (secondsBetween(delay_estimated_ns_, piece.to_ns) > kPeriod) {
    delay_estimated_ns_ = piece.to_ns;
    estimateDelay(speeds);
  }
}

/// Relative residual of the distances for every shift, each with the scale that fits it best.
void SpeedCheck::estimateDelay(const SpeedTrack& speeds) {
  double least = std::numeric_limits<double>::infinity(), without_shift = least, best = 0;
  const int steps = static_cast<int>(std::lround(kMaxDelay / kDelayStep));
  const auto metresOf = [&](const Piece& piece, double shift_s) {
    const auto shift_ns = static_cast<std::int64_t>(1e9 * shift_s);
    const auto distance = speeds.distance(piece.from_ns + shift_ns, piece.to_ns + shift_ns);
    return distance ? std::optional<double>(std::abs(distance->metres)) : std::nullopt;
  };
  std::vector<const Piece*> covered;
  for (const Piece& piece : pieces_) {
    const bool is_covered = metresOf(piece, -kMaxDelay) && metresOf(piece, kMaxDelay);
    if (piece.accepted && is_covered) covered.push_back(&piece);
  }
  if (covered.size() < kMinPieces) return;
  for (int k = -steps; k <= steps; ++k) {
    double mm = 0, mu = 0, uu = 0;
    for (const Piece* piece : covered) {
      const double metres = metresOf(*piece, k * kDelayStep).value_or(0);
      mm += metres * metres;
      mu += metres * piece->units;
      uu += piece->units * piece->units;
    }
    const double residual = std::sqrt(std::max(0.0, 1 - mu * mu / (mm * uu)));
    if (k == 0) without_shift = residual;
    if (residual < least) {
      least = residual;
      best = k * kDelayStep;
    }
  }
  // A best shift at the border of the range is no minimum.
  const bool is_delayed = std::abs(best) >= kMinDelay && std::abs(best) < kMaxDelay - 1e-6 &&
                          without_shift > kMinResidual && least < kMaxResidualRatio * without_shift;
  delay_ = is_delayed ? best : 0;
}

std::string SpeedCheck::warning(const SpeedTrack& speeds, std::int64_t stamp_ns) const {
  if (speeds.empty()) return "no speed has arrived yet";
  const double ahead = secondsBetween(stamp_ns, speeds.newest().stamp_ns);
  if (std::abs(ahead) > kOtherClock) {
    const char* hint = ahead > 0 ? "" : ": the sensor is silent, or its clock is another one";
    return format("the newest speed is %.1f s %s than the images%s", std::abs(ahead),
                  ahead > 0 ? "later" : "earlier", hint);
  }
  if (delay_ != 0) {
    return format(
        "the speeds are %.2f s %s than the motion in the images: their stamps are not "
        "those of the measurement",
        std::abs(delay_), delay_ > 0 ? "later" : "earlier");
  }
  if (speeds.jumped()) {
    return format("the speed jumps to %.2f m/s: wheel slip, or a sensor that fails",
                  speeds.newest().speed);
  }
  if (rejected_ >= kMinRejected && speeds.repeats()) {
    return format("the speed repeats %.2f m/s while the motion changes: the sensor is stuck",
                  speeds.samples().back().speed);
  }
  if (rejected_ >= kMinRejected) {
    return format("the speed is %.0f %% %s than the odometry's: wheel slip, or another unit",
                  100 * std::abs(std::expm1(rejected_error_)),
                  rejected_error_ > 0 ? "higher" : "lower");
  }
  if (signed_pieces_ >= kMinSignedPieces && sign_ < -0.5) {
    return "the sign of the speed is opposite to the motion along the optical axis, as for a "
           "camera "
           "that looks backwards: only its absolute value is used";
  }
  return "";
}

}  // namespace ground_scale_vo
