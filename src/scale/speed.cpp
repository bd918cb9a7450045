#include "ground_scale_vo/scale/speed.hpp"

#include <algorithm>
#include <cmath>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace {

/// Largest deviation of ln of the ratio: half of the difference between knots and mph.
constexpr double kMaxUnitDeviation = 0.07;

constexpr double kMaxVariance = 100;  ///< [m^2/s^2] more stands for "not known"
/// Above this speed [m/s], a velocity at more than 45 degrees to x is not along x.
constexpr double kMinDirectionSpeed = 2;

double finiteOrZero(double value) { return std::isfinite(value) ? value : 0; }

}  // namespace

const SpeedUnit& speedUnit(const std::string& name) {
  std::string names;
  for (const SpeedUnit& unit : kSpeedUnits) {
    if (name == unit.name) return unit;
    names += (names.empty() ? "" : ", ") + std::string(unit.name);
  }
  throw OptionError("'" + name + "' is no unit of a speed, known are " + names);
}

std::string unitMistake(double ratio) {
  for (std::size_t i = 1; i < kSpeedUnits.size(); ++i) {
    const double log_factor = -std::log(kSpeedUnits[i].metres_per_second);
    const double log_ratio = std::log(ratio);
    if (std::abs(log_ratio - log_factor) < kMaxUnitDeviation) {
      return format("%s taken as m/s", kSpeedUnits[i].symbol);
    }
    if (std::abs(log_ratio + log_factor) < kMaxUnitDeviation) {
      return format("m/s taken as %s", kSpeedUnits[i].symbol);
    }
  }
  return "";
}

SpeedSample VelocityReader::read(std::int64_t stamp_ns, const std::array<double, 3>& velocity,
                                 double variance) {
  if (stamp_ns == 0) throw DataError("has a stamp of zero, so its time is not known");
  const double factor = unit_.metres_per_second, x = factor * velocity[0];
  if (!std::isfinite(x)) throw DataError("is not finite");
  const double across = factor * std::hypot(finiteOrZero(velocity[1]), finiteOrZero(velocity[2]));
  const double norm = std::hypot(x, across);
  if (norm > kMinDirectionSpeed && across > std::abs(x)) has_vehicle_axes_ = false;
  const double sigma = factor * std::sqrt(std::max(0.0, variance));
  return {stamp_ns, has_vehicle_axes_ ? std::copysign(norm, x) : norm,
          sigma * sigma <= kMaxVariance ? sigma : 0};
}

}  // namespace gsv
