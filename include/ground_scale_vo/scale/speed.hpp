#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace gsv {

/// Speed of the vehicle at one instant, of a wheel odometry, CAN bus or GPS.
struct SpeedSample {
  std::int64_t stamp_ns = 0;  ///< of the clock of the images [ns]
  double speed = 0;           ///< [m/s], negative: backwards
  double sigma = 0;           ///< standard deviation [m/s]; 0: not known
};

/// [m/s] A vehicle is not faster.
constexpr double kMaxVehicleSpeed = 200;

/// A unit in which speeds may be given.
struct SpeedUnit {
  const char* name;          ///< of options and parameters; of a column: speed_NAME
  const char* symbol;        ///< in sentences
  double metres_per_second;  ///< of a speed of 1 in this unit
};
constexpr std::array<SpeedUnit, 5> kSpeedUnits = {{{"mps", "m/s", 1},
                                                   {"kmh", "km/h", 1 / 3.6},
                                                   {"mph", "mph", 0.44704},
                                                   {"knots", "knots", 1852 / 3600.0},
                                                   {"mmps", "mm/s", 0.001}}};

/// Throws OptionError that names the units.
const SpeedUnit& speedUnit(const std::string& name);

/// The mistake that gives speeds of `ratio` times the right ones, such as "km/h taken as m/s";
/// empty when no unit does, within 7 %.
std::string unitMistake(double ratio);

/// Speeds from the messages of a vehicle: the length of the velocity with the sign of x, negative
/// is backwards. Once a velocity is not along x, as that of a GPS in east, north and up, speeds are
/// positive.
class VelocityReader {
 public:
  /// unit: of the velocities.
  explicit VelocityReader(const SpeedUnit& unit = kSpeedUnits[0]) : unit_(unit) {}

  /// variance: of x; one that is not positive, not finite or above 100 m^2/s^2 is not known: sigma
  /// is 0. y and z that are not finite count as 0. Throws DataError, whose sentence continues
  /// "speed on TOPIC": a stamp of zero, an x that is not finite.
  SpeedSample read(std::int64_t stamp_ns, const std::array<double, 3>& velocity, double variance);
  bool hasVehicleAxes() const { return has_vehicle_axes_; }

 private:
  SpeedUnit unit_;
  bool has_vehicle_axes_ = true;
};

}  // namespace gsv
