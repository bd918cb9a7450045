#include "ground_scale_vo/ros/mounting_check.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>

#include "ground_scale_vo/common/degrees.hpp"
#include "ground_scale_vo/scale/mounting.hpp"

namespace ground_scale_vo {
namespace {

/// [deg] Deviation that is still accepted. A correct transform deviates, too: load and springs tilt
/// a vehicle by 1 to 2 degrees, steadily, and the road is estimated from this vehicle. Over all
/// scenarios the estimate itself deviates from the true mounting by at most 1.9.
constexpr double kLimitDeg = 3;
/// [deg] Largest standard deviation of an estimate that is compared. Below it at least about eight
/// camera heights have been averaged: a single braking or a kerb no longer decides.
constexpr double kMaxSigmaDeg = 0.5;
constexpr double kSigmas = 3;

/// Without the minus sign of a value that is rounded to zero.
double rounded(double degrees) { return std::round(10 * degrees) / 10 + 0.0; }

}  // namespace

std::string mountingContradiction(const std::string& base_frame, const std::string& camera_frame,
                                  const Eigen::Vector3d& up_c,
                                  const ScaleRecovery::Output& output) {
  const double sigma_deg = kDegreesPerRadian * output.mounting_sigma;
  if (sigma_deg > kMaxSigmaDeg) return {};
  const Eigen::Vector3d n_c = roadNormal(output.mounting_pitch, output.mounting_roll);
  const double deviation_deg =
      kDegreesPerRadian * std::atan2(up_c.cross(n_c).norm(), up_c.dot(n_c));
  if (!(deviation_deg > kLimitDeg + kSigmas * sigma_deg)) return {};
  char angles[160];
  std::snprintf(angles, sizeof angles,
                "with pitch %.1f deg and roll %.1f deg, but on the road it has pitch %.1f deg and "
                "roll %.1f deg",
                rounded(kDegreesPerRadian * pitchOf(up_c)),
                rounded(kDegreesPerRadian * rollOf(up_c)),
                rounded(kDegreesPerRadian * output.mounting_pitch),
                rounded(kDegreesPerRadian * output.mounting_roll));
  char consequence[80];
  std::snprintf(consequence, sizeof consequence, "the path climbs or sinks by up to %.1f deg",
                deviation_deg);
  return "tf mounts the camera \"" + camera_frame + "\" on \"" + base_frame + "\" " + angles +
         ": " + consequence;
}

}  // namespace ground_scale_vo
