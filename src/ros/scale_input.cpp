#include "ros/scale_input.hpp"

#include <geometry_msgs/TwistStamped.h>
#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <nav_msgs/Odometry.h>
#include <std_msgs/Float32.h>
#include <std_msgs/Float64.h>

#include <cmath>
#include <limits>

#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace {

/// The stamp, and the velocity with its covariance, which is 0 for a type without.
nav_msgs::Odometry velocityOf(const topic_tools::ShapeShifter& message, ros::Time arrival) {
  const auto is = [&](const char* type) { return message.getDataType() == type; };
  nav_msgs::Odometry velocity;
  try {
    if (is("nav_msgs/Odometry")) return *message.instantiate<nav_msgs::Odometry>();
    if (is("geometry_msgs/TwistWithCovarianceStamped")) {
      const auto stamped = message.instantiate<geometry_msgs::TwistWithCovarianceStamped>();
      velocity.header = stamped->header;
      velocity.twist = stamped->twist;
      return velocity;
    }
    if (is("geometry_msgs/TwistStamped")) {
      const auto stamped = message.instantiate<geometry_msgs::TwistStamped>();
      velocity.header = stamped->header;
      velocity.twist.twist = stamped->twist;
      return velocity;
    }
    velocity.header.stamp = arrival;
    double& x = velocity.twist.twist.linear.x;
    if (is("std_msgs/Float32")) {
      x = message.instantiate<std_msgs::Float32>()->data;
      return velocity;
    }
    if (is("std_msgs/Float64")) {
      x = message.instantiate<std_msgs::Float64>()->data;
      return velocity;
    }
  } catch (const ros::Exception& error) {  // another definition of the type, or truncated
    throw DataError(std::string("cannot be read: ") + error.what());
  }
  throw DataError("has the type " + message.getDataType() +
                  ", accepted are nav_msgs/Odometry, geometry_msgs/TwistStamped, "
                  "geometry_msgs/TwistWithCovarianceStamped, std_msgs/Float32 and "
                  "std_msgs/Float64");
}

}  // namespace

void FrameContinuity::receive(std::uint32_t sequence) {
  sequence_error_.clear();
  const std::uint32_t last = last_received_.value_or(sequence - 1);
  last_received_ = sequence;
  repeats_ = sequence == last ? repeats_ + 1 : 0;
  const std::uint32_t gap = sequence > last ? sequence - last - 1 : 0;
  // 0 twice: two restarts, an image between them.
  if (gap > kMaxGap || repeats_ > (sequence == 0 ? 1 : 0)) {
    sequence_error_ = "sequence of vo/frame is " + std::to_string(sequence) + " after " +
                      std::to_string(last) + ": the odometry must count its images in it, " +
                      "otherwise its restarts and lost frames are not detected";
  } else {
    missing_ += gap;
  }
}

std::string FrameContinuity::next(VoFrame& frame, const std::string& camera_frame,
                                  bool clock_jumped_back) {
  std::string reason;
  if (clock_jumped_back) {
    reason = "the clock jumped back";
  } else if (!camera_frame.empty() && !camera_frame_.empty() && camera_frame != camera_frame_) {
    reason = "the camera frame of vo/frame changed from \"" + camera_frame_ + "\" to \"" +
             camera_frame + "\"";
  }
  if (!camera_frame.empty()) camera_frame_ = camera_frame;
  if (!reason.empty()) startTrajectory();
  numberMap(frame);
  if (!map_id_) {
    frame.continuity = Continuity::kNewTrajectory;
  } else if (frame.status == VoStatus::kLost) {
    return reason;  // it belongs to no map
  } else if (frame.map_id != *map_id_) {
    frame.continuity = Continuity::kNewMap;
  } else if (!isSameCamera(frame.camera, camera_)) {
    frame.continuity = Continuity::kOtherLens;
  }
  map_id_ = frame.map_id;
  camera_ = frame.camera;
  return reason;
}

void FrameContinuity::numberMap(VoFrame& frame) {
  if (last_sequence_ && frame.sequence < *last_sequence_) {
    map_id_offset_ = last_map_id_ + 1;
    if (map_id_) map_of_unknown_rotation_ = frame.map_id + map_id_offset_;
  }
  last_sequence_ = frame.sequence;
  frame.map_id += map_id_offset_;
  last_map_id_ = frame.map_id;
  if (frame.map_id == map_of_unknown_rotation_) {
    frame.map_start.rotation_sigma = std::numeric_limits<double>::infinity();
  }
}

SpeedReader::SpeedReader(const std::string& unit)
    : has_unit_(!unit.empty()), velocities_(has_unit_ ? speedUnit(unit) : kSpeedUnits[0]) {}

SpeedSample SpeedReader::read(const topic_tools::ShapeShifter& message, ros::Time arrival) {
  const nav_msgs::Odometry velocity = velocityOf(message, arrival);
  if (!has_unit_ && message.getDataType().rfind("std_msgs/", 0) == 0) {
    throw DataError("has the type " + message.getDataType() +
                    ", whose unit is not known: set speed_unit to mps, kmh, mph, knots or mmps");
  }
  const geometry_msgs::Vector3& linear = velocity.twist.twist.linear;
  return velocities_.read(toNanoseconds(velocity.header.stamp), {linear.x, linear.y, linear.z},
                          velocity.twist.covariance[0]);
}

}  // namespace gsv
