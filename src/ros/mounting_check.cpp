#include "ground_scale_vo/ros/mounting_check.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/common/text.hpp"
#include "ground_scale_vo/scale/mounting.hpp"

namespace ground_scale_vo {
namespace {

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

struct Angles {
  double pitch_deg, roll_deg;
};

Angles anglesOf(const Eigen::Vector3d& up_c) {
  return {kDegreesPerRadian * pitchOf(up_c), kDegreesPerRadian * rollOf(up_c)};
}

bool isSupported(const Angles& angles, double tolerance_deg) {
  return std::abs(angles.pitch_deg) <= kMaxPitchDeg + tolerance_deg &&
         std::abs(angles.roll_deg) <= kMaxRollDeg + tolerance_deg;
}

/// Without the minus sign of a value that is rounded to zero.
double rounded(double degrees) { return std::round(10 * degrees) / 10 + 0.0; }

std::string text(const Angles& angles) {
  return format("pitch %.1f deg and roll %.1f deg", rounded(angles.pitch_deg),
                rounded(angles.roll_deg));
}

std::string notSupported() {
  return format(
      ", but at most %.0f deg of pitch and %.0f deg of roll are supported: distances may be wrong; "
      "mount the camera upright or rotate its images",
      kMaxPitchDeg, kMaxRollDeg);
}

}  // namespace

std::string unsupportedMounting(const ScaleRecovery::Output& output,
                                const std::optional<Eigen::Vector3d>& turn_axis_c) {
  // First: where the road is not below the camera, a plane may be measured that is none.
  if (turn_axis_c && !isSupported(anglesOf(*turn_axis_c), kTurnAxisErrorDeg)) {
    return "in turns the camera has " + text(anglesOf(*turn_axis_c)) + notSupported();
  }
  const double sigma_deg = kDegreesPerRadian * output.mounting_sigma;
  const Angles measured = anglesOf(roadNormal(output.mounting_pitch, output.mounting_roll));
  if (sigma_deg > kMaxSigmaDeg || isSupported(measured, kEstimateErrorDeg + kSigmas * sigma_deg)) {
    return {};
  }
  return "on the road the camera has " + text(measured) + notSupported();
}

std::string wrongMountingOnTf(const std::string& base_frame, const std::string& camera_frame,
                              const Eigen::Vector3d& up_c, const ScaleRecovery::Output& output) {
  const std::string on_tf = "tf mounts the camera \"" + camera_frame + "\" on \"" + base_frame +
                            "\" with " + text(anglesOf(up_c));
  const double sigma_deg = kDegreesPerRadian * output.mounting_sigma;
  const Eigen::Vector3d n_c = roadNormal(output.mounting_pitch, output.mounting_roll);
  const double deviation_deg =
      kDegreesPerRadian * std::atan2(up_c.cross(n_c).norm(), up_c.dot(n_c));
  if (sigma_deg <= kMaxSigmaDeg && deviation_deg > kLimitDeg + kSigmas * sigma_deg) {
    return on_tf + ", but on the road it has " + text(anglesOf(n_c)) +
           format(": the path climbs or sinks by up to %.1f deg", deviation_deg);
  }
  return isSupported(anglesOf(up_c), kEstimateErrorDeg) ? "" : on_tf + notSupported();
}

}  // namespace ground_scale_vo
