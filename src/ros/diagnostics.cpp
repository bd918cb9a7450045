#include "ros/diagnostics.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ros/odometry_output.hpp"
#include "scale/road.hpp"

namespace gsv {
namespace {

constexpr double kHeldS = 3.0;  // [s] shorter gaps between measurements occur in every drive

/// Rotation of which the axis is one sample: a vehicle hardly pitches or rolls by so much.
constexpr double kTurn = 10 * kRadiansPerDegree;
constexpr int kMinTurns = 4;

/// [deg] Supported angles of the mounting, either way.
constexpr double kMaxPitchDeg = 20, kMaxRollDeg = 15;
/// [deg] Over all scenarios the estimate deviates from the true mounting by at most 1.9.
constexpr double kEstimateErrorDeg = 2;
/// [deg] Slopes and the suspension tilt the axis of the turns; on all KITTI sequences by at most 4.
constexpr double kTurnAxisErrorDeg = 10;
/// [deg] Deviation from tf that is still accepted. A correct transform deviates, too: load and
/// springs tilt a vehicle by 1 to 2 degrees, steadily, and the road is estimated from this vehicle.
constexpr double kLimitDeg = 3;
/// [deg] Largest standard deviation of an estimate that is compared. Below it at least about eight
/// camera heights have been averaged: a single braking or a kerb no longer decides.
constexpr double kMaxSigmaDeg = 0.5;
constexpr double kSigmas = 3;

// As calibrate_height: what the estimate has in common over a drive, and the largest error of a
// height that is saved, both relative; two sigma for 95 %.
constexpr double kHeightMethodSigma = 0.003, kMaxHeightError = 0.05, kSigmas95 = 1.96;
/// Share of the given standard deviation below which the height counts as learned.
constexpr double kLearnedShare = 0.7;

/// Without the minus sign of a value that is rounded to zero.
double rounded(double degrees) { return std::round(10 * degrees) / 10 + 0.0; }

std::string text(const Eigen::Vector3d& up_c) {
  return format("pitch %.1f deg and roll %.1f deg", rounded(kDegreesPerRadian * pitchOf(up_c)),
                rounded(kDegreesPerRadian * rollOf(up_c)));
}

/// subject: what has the mounting, up to "with" or "has". Empty: it is supported.
std::string unsupported(const std::string& subject, const Eigen::Vector3d& up_c,
                        double tolerance_deg) {
  if (std::abs(kDegreesPerRadian * pitchOf(up_c)) <= kMaxPitchDeg + tolerance_deg &&
      std::abs(kDegreesPerRadian * rollOf(up_c)) <= kMaxRollDeg + tolerance_deg) {
    return {};
  }
  return subject + text(up_c) +
         format(
             ", but at most %.0f deg of pitch and %.0f deg of roll are supported: distances may "
             "be wrong; mount the camera upright or rotate its images",
             kMaxPitchDeg, kMaxRollDeg);
}

}  // namespace

bool WarningLog::print(ros::console::Level level, const std::string& kind,
                       const std::string& sentence, std::chrono::milliseconds period) {
  const auto now = std::chrono::steady_clock::now();
  const auto [printed, is_first] = printed_.try_emplace(kind, now);
  if (!is_first && now - printed->second < period) return false;
  printed->second = now;
  ROS_LOG_STREAM(level, ROSCONSOLE_NAME_PREFIX "." + nodelet_, nodelet_ << ": " << sentence);
  return true;
}

bool WarningLog::drop(const std::string& kind, const std::string& sentence, bool is_error) {
  const std::string counted =
      sentence + " (" + kind + ": " + std::to_string(++dropped_[kind]) + " so far)";
  return is_error ? error(kind, counted) : warn(kind, counted);
}

std::uint64_t WarningLog::dropped(const std::string& prefix) const {
  std::uint64_t sum = 0;
  for (const auto& [kind, count] : dropped_) {
    if (kind.compare(0, prefix.size(), prefix) == 0) sum += count;
  }
  return sum;
}

void WarningLog::warnOfState(const std::string& sentence) {
  std::string kind;
  std::remove_copy_if(sentence.begin(), sentence.end(), std::back_inserter(kind),
                      [](char c) { return c >= '-' && c <= '9'; });
  if (!kind.empty()) warn(kind, sentence, std::chrono::hours(1));
}

DiagnosticStatus statusOf(std::int8_t level, const std::string& message) {
  DiagnosticStatus result;
  result.level = level;
  result.message = message;
  return result;
}

DiagnosticStatus summarize(const ScaleEstimate& scale, double held_s,
                           const std::string& missing_image) {
  const std::string reason = toString(scale.measurement);
  if (scale.status == ScaleStatus::kUnknown) {
    const bool is_measured = scale.measurement == MeasurementStatus::kMeasured;
    return statusOf(DiagnosticStatus::WARN,
                    "scale not known yet" + (is_measured ? "" : ": " + reason));
  }
  if (scale.status == ScaleStatus::kOk) {
    if (missing_image.empty()) return statusOf(DiagnosticStatus::OK, "scale measured");
    return statusOf(DiagnosticStatus::WARN, "scale measured from features only, " + missing_image);
  }
  if (scale.measurement == MeasurementStatus::kStandstill) {
    return statusOf(DiagnosticStatus::OK, "scale held: " + reason);
  }
  const bool is_normal = scale.measurement != MeasurementStatus::kVoNotTracking && held_s < kHeldS;
  return statusOf(is_normal ? DiagnosticStatus::OK : DiagnosticStatus::WARN,
                  format("scale held for %.1f s: ", held_s) + reason);
}

void TurnAxis::add(const VoFrame& frame) {
  if (frame.continuity >= Continuity::kNewMapSameUnit) start_.reset();
  if (frame.status != VoStatus::kTracking) return;
  const Eigen::Matrix3d R_w_c = frame.T_w_c.linear();
  if (!start_) start_ = R_w_c;
  const Eigen::Vector3d turn_c = rotationVector(start_->transpose() * R_w_c);
  if (turn_c.norm() < kTurn) return;
  scatter_ += turn_c.normalized() * turn_c.normalized().transpose();
  start_ = R_w_c;
  ++turns_;
}

std::optional<Eigen::Vector3d> TurnAxis::upward() const {
  if (turns_ < kMinTurns) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter_);
  const Eigen::Vector3d axis = solver.eigenvectors().col(2);  // of the largest eigenvalue
  return axis.y() > 0 ? Eigen::Vector3d(-axis) : axis;
}

std::string mountingWarning(const ScaleRecovery::Output& measured,
                            const std::optional<Eigen::Vector3d>& turn_axis_c,
                            const TfFrames* on_tf, const std::string& camera_frame) {
  // First: where the road is not below the camera, a plane may be measured that is none.
  std::string warning;
  if (turn_axis_c)
    warning = unsupported("in turns the camera has ", *turn_axis_c, kTurnAxisErrorDeg);
  const double sigma_deg = kDegreesPerRadian * measured.mounting_sigma;
  const bool is_known = sigma_deg <= kMaxSigmaDeg;
  const Eigen::Vector3d n_c = roadNormal(measured.mounting_pitch, measured.mounting_roll);
  if (warning.empty() && is_known) {
    warning =
        unsupported("on the road the camera has ", n_c, kEstimateErrorDeg + kSigmas * sigma_deg);
  }
  if (!warning.empty() || on_tf == nullptr) return warning;
  const std::string tf =
      "tf mounts the camera \"" + camera_frame + "\" on \"" + on_tf->base_frame + "\" with ";
  const Eigen::Vector3d up_c = on_tf->T_c_b.linear().col(2);
  const double deviation_deg =
      kDegreesPerRadian * std::atan2(up_c.cross(n_c).norm(), up_c.dot(n_c));
  if (is_known && deviation_deg > kLimitDeg + kSigmas * sigma_deg) {
    return tf + text(up_c) + ", but on the road it has " + text(n_c) +
           format(": the path climbs or sinks by up to %.1f deg", deviation_deg);
  }
  return unsupported(tf, up_c, kEstimateErrorDeg);
}

std::string learnedHeightYaml(const ScaleRecovery::Output& measured, double given_sigma) {
  const double height = measured.scale.camera_height, sigma = measured.scale.camera_height_sigma;
  if (height == 0) throw DataError("the camera height is not known yet: drive farther");
  if (sigma == 0) throw DataError("the given camera_height is exact, as camera_height_sigma is 0");
  const double error95 = kSigmas95 * std::hypot(sigma, kHeightMethodSigma * height);
  const double percent = 100 * error95 / height;
  if (percent > 100 * kMaxHeightError || (given_sigma > 0 && sigma > kLearnedShare * given_sigma)) {
    throw DataError(
        format("the camera height would be %.2f m, but speeds have not determined it yet: its "
               "error is %.1f %% (95 %%); drive farther",
               height, percent));
  }
  const double angle95 = kSigmas95 * measured.mounting_sigma;
  return heightYaml("the speeds of the vehicle", height, error95) +
         mountingComments(height, measured.mounting_pitch, angle95, measured.mounting_roll,
                          angle95);
}

}  // namespace gsv
