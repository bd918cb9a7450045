#include "simulation/speed_sensor.hpp"

#include <random>

#include "common/time.hpp"

namespace gsv {
namespace {

constexpr std::int64_t kSpeedInterval = 100000000;  ///< [ns]
constexpr double kSpeedNoise = 0.005;
constexpr double kSlipFactor = 1.3, kFaultTime = 2;  ///< [s]
constexpr std::int64_t kSpeedDelay = 200000000;      ///< [ns]
constexpr double kKilometresPerHour = 3.6;
constexpr unsigned kSpeedSeed = 1;

}  // namespace

std::vector<SpeedSample> simulateSpeeds(const SyntheticDrive& drive, SpeedFault fault) {
  std::mt19937 random(kSpeedSeed);
  std::normal_distribution<double> noise(1, kSpeedNoise);
  std::vector<SpeedSample> speeds;
  const std::int64_t middle_ns = drive.frame(drive.size() / 2).stamp_ns;
  double at_middle = 0;
  std::size_t i = 1;
  for (std::int64_t t = drive.frame(0).stamp_ns; t <= drive.frame(drive.size() - 1).stamp_ns;
       t += kSpeedInterval) {
    while (i + 1 < drive.size() && drive.frame(i).stamp_ns < t) ++i;
    const SyntheticDrive::Frame &a = drive.frame(i - 1), &b = drive.frame(i);
    const double share = secondsBetween(a.stamp_ns, t) / secondsBetween(a.stamp_ns, b.stamp_ns);
    SpeedSample sample{t, (a.speed + share * (b.speed - a.speed)) * noise(random), 0};
    if (t <= middle_ns) at_middle = sample.speed;
    const bool has_fault = t > middle_ns;
    const bool is_short = has_fault && secondsBetween(middle_ns, t) <= kFaultTime;
    if (fault == SpeedFault::kGap && is_short) continue;
    if (fault == SpeedFault::kSlip && is_short) sample.speed *= kSlipFactor;
    if (fault == SpeedFault::kStuck && has_fault) sample.speed = at_middle;
    if (fault == SpeedFault::kZero && has_fault) sample.speed = 0;
    if (fault == SpeedFault::kSign) sample.speed *= -1;
    if (fault == SpeedFault::kLate) sample.stamp_ns += kSpeedDelay;
    if (fault == SpeedFault::kUnit) sample.speed *= kKilometresPerHour;
    speeds.push_back(sample);
  }
  return speeds;
}

}  // namespace gsv
