#include "ground_scale_vo/ros/speed_input.hpp"

#include <geometry_msgs/TwistStamped.h>
#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>

#include <cmath>

namespace ground_scale_vo {
namespace {

constexpr double kMaxVariance = 100;  ///< [m^2/s^2] more stands for "not known"

/// Above this speed [m/s], a velocity at more than 45 degrees to x is not along x.
constexpr double kMinDirectionSpeed = 2;

/// The stamp, the velocity and its variance, which is 0 for a type without.
struct Velocity {
  ros::Time stamp;
  geometry_msgs::Vector3 linear;
  double variance = 0;
};

Velocity velocityOf(const topic_tools::ShapeShifter& message) {
  const auto is = [&](const char* type) { return message.getDataType() == type; };
  try {
    if (is("nav_msgs/Odometry")) {
      const auto odometry = message.instantiate<nav_msgs::Odometry>();
      const auto& twist = odometry->twist;
      return {odometry->header.stamp, twist.twist.linear, twist.covariance[0]};
    }
    if (is("geometry_msgs/TwistWithCovarianceStamped")) {
      const auto stamped = message.instantiate<geometry_msgs::TwistWithCovarianceStamped>();
      const auto& twist = stamped->twist;
      return {stamped->header.stamp, twist.twist.linear, twist.covariance[0]};
    }
    if (is("geometry_msgs/TwistStamped")) {
      const auto stamped = message.instantiate<geometry_msgs::TwistStamped>();
      return {stamped->header.stamp, stamped->twist.linear};
    }
  } catch (const ros::Exception& error) {  // another definition of the type, or truncated
    throw SpeedTypeError(std::string("cannot be read: ") + error.what());
  }
  throw SpeedTypeError("has the type " + message.getDataType() +
                       ", accepted are nav_msgs/Odometry, geometry_msgs/TwistStamped and "
                       "geometry_msgs/TwistWithCovarianceStamped");
}

double finiteOrZero(double value) { return std::isfinite(value) ? value : 0; }

}  // namespace

SpeedSample SpeedReader::read(const topic_tools::ShapeShifter& message) {
  const Velocity velocity = velocityOf(message);
  if (velocity.stamp.isZero()) {
    throw MessageError("has a stamp of zero, so its time is not known");
  }
  const double x = velocity.linear.x;
  if (!std::isfinite(x)) throw MessageError("is not finite");
  const double across =
      std::hypot(finiteOrZero(velocity.linear.y), finiteOrZero(velocity.linear.z));
  const double norm = std::hypot(x, across);
  if (norm > kMinDirectionSpeed && across > std::abs(x)) has_vehicle_axes_ = false;
  const bool has_variance = velocity.variance > 0 && velocity.variance <= kMaxVariance;
  return {toNanoseconds(velocity.stamp), has_vehicle_axes_ ? std::copysign(norm, x) : norm,
          has_variance ? std::sqrt(velocity.variance) : 0};
}

}  // namespace ground_scale_vo
