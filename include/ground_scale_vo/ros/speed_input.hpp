#pragma once

#include <topic_tools/shape_shifter.h>

#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/scale/speed.hpp"

namespace ground_scale_vo {

/// The topic has a type that holds no speed.
class SpeedTypeError : public MessageError {
 public:
  using MessageError::MessageError;
};

/// Converts the messages of the topic `speed`, whose type is found at run time:
/// nav_msgs/Odometry, geometry_msgs/TwistStamped or geometry_msgs/TwistWithCovarianceStamped.
///
/// The speed is the length of twist.linear, whose axes therefore do not matter, with the sign of x:
/// negative is backwards. Once a velocity is not along x, as that of a GPS in east, north and up,
/// x has no meaning for the vehicle: from then on speeds are positive.
class SpeedReader {
 public:
  /// A variance (twist.covariance[0]) that is not positive, not finite or above 100 m^2/s^2 is not
  /// known: sigma is 0. Components y and z that are not finite count as 0. Throws SpeedTypeError,
  /// and MessageError for a stamp of zero and an x that is not finite; their sentences continue
  /// "speed on TOPIC".
  SpeedSample read(const topic_tools::ShapeShifter& message);

  /// False: a velocity was not along x.
  bool hasVehicleAxes() const { return has_vehicle_axes_; }

 private:
  bool has_vehicle_axes_ = true;
};

}  // namespace ground_scale_vo
