#pragma once

#include <nav_msgs/Odometry.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "fuzz_target.hpp"
#include "ground_scale_vo/ros/messages.hpp"

/// Checks of published messages that hold for any input.
namespace ground_scale_vo::fuzz {

template <typename Range>
bool allFinite(const Range& values) {
  return std::all_of(values.begin(), values.end(), [](auto value) { return std::isfinite(value); });
}

inline bool isPose(const geometry_msgs::Pose& pose) {
  const auto& p = pose.position;
  const auto& q = pose.orientation;
  const double norm = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z) &&
         std::abs(norm - 1) < 1e-6;
}

inline void check(const nav_msgs::Odometry& odometry) {
  require(isPose(odometry.pose.pose), "the pose of the odometry is valid");
  require(allFinite(odometry.pose.covariance), "the pose covariance is finite");
  const auto& v = odometry.twist.twist.linear;
  const auto& w = odometry.twist.twist.angular;
  for (const double value : {v.x, v.y, v.z, w.x, w.y, w.z}) {
    require(std::isfinite(value), "the twist is finite");
  }
  require(allFinite(odometry.twist.covariance), "the twist covariance is finite");
}

inline void check(const VoFrameMsg& frame) {
  require(isPose(frame.pose), "the pose of the frame is valid");
  require(allFinite(frame.u) && allFinite(frame.v), "the pixels are finite");
  for (std::size_t i = 0; i < frame.id.size(); ++i) {
    const float values[] = {frame.x[i], frame.y[i], frame.z[i], frame.depth_sigma[i]};
    const auto finite = std::count_if(std::begin(values), std::end(values),
                                      [](float value) { return std::isfinite(value); });
    require(finite == 0 || finite == 4, "a point is complete or absent");
    require(finite == 0 || (frame.z[i] > 0 && frame.depth_sigma[i] >= 0), "a point lies ahead");
  }
}

inline void check(const ScaleEstimateMsg& scale) {
  for (const double value : {scale.raw_scale, scale.scale, scale.sigma, scale.height,
                             scale.normal.x, scale.normal.y, scale.normal.z}) {
    require(std::isfinite(value), "the scale is finite");
  }
  require((scale.status == ScaleEstimateMsg::UNKNOWN) == (scale.scale == 0),
          "the scale is set if and only if it is known");
  require(scale.scale >= 0 && scale.sigma >= 0, "scale and sigma are not negative");
}

/// Clouds of x, y, z [float32].
inline void check(const sensor_msgs::PointCloud2& cloud) {
  for (std::size_t at = 0; at + cloud.point_step <= cloud.data.size(); at += cloud.point_step) {
    float xyz[3];
    std::memcpy(xyz, &cloud.data[at], sizeof xyz);
    for (const float value : xyz) require(std::isfinite(value), "the cloud is finite");
  }
}

}  // namespace ground_scale_vo::fuzz
