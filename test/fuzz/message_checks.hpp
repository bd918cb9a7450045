#pragma once

#include <nav_msgs/Odometry.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

#include "fuzz_target.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "simulation/synthetic_drive.hpp"

/// Valid images, and checks of published messages that hold for any input.
namespace gsv::fuzz {

/// The first frames of a rendered drive with small images.
struct SmallDrive {
  SmallDrive() {
    SyntheticDrive::Options options;
    options.camera = camera;
    options.frames = 24;
    const SyntheticDrive drive(options);
    for (std::size_t i = 0; i < drive.size(); ++i) {
      images.push_back(drive.image(i));
      // Starts at 1 s: a stamp of 0 means "no stamp" in ROS.
      stamps_ns.push_back(drive.frame(i).stamp_ns + 1000000000);
    }
  }

  const PinholeCamera camera{480, 150, 278, 278, 240, 55};
  std::vector<cv::Mat> images;
  std::vector<std::int64_t> stamps_ns;
};

/// Rendered at the first call.
inline const SmallDrive& smallDrive() {
  static const SmallDrive kDrive;
  return kDrive;
}

/// An input of messages of which one in `period` is odd, that is, with changes.
inline std::string mixedMessages(int period) {
  std::string mixed;
  for (int i = 0; i < 40; ++i) {
    mixed += {static_cast<char>(i % period == period - 1), static_cast<char>(7 * i)};
  }
  return mixed;
}

template <typename Range = std::initializer_list<double>>
bool allFinite(const Range& values) {
  return std::all_of(std::begin(values), std::end(values),
                     [](auto value) { return std::isfinite(value); });
}

inline bool isPose(const geometry_msgs::Pose& pose) {
  const auto& p = pose.position;
  const auto& q = pose.orientation;
  const double norm = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  return allFinite({p.x, p.y, p.z}) && std::abs(norm - 1) < 1e-6;
}

inline void check(const nav_msgs::Odometry& odometry) {
  require(isPose(odometry.pose.pose), "the pose of the odometry is valid");
  require(allFinite(odometry.pose.covariance), "the pose covariance is finite");
  const auto& v = odometry.twist.twist.linear;
  const auto& w = odometry.twist.twist.angular;
  require(allFinite({v.x, v.y, v.z, w.x, w.y, w.z}), "the twist is finite");
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
  require(allFinite({scale.raw_scale, scale.scale, scale.sigma, scale.height, scale.normal.x,
                     scale.normal.y, scale.normal.z}),
          "the scale is finite");
  require((scale.status == ScaleEstimateMsg::UNKNOWN) == (scale.scale == 0),
          "the scale is set if and only if it is known");
  require(scale.scale >= 0 && scale.sigma >= 0, "scale and sigma are not negative");
}

}  // namespace gsv::fuzz
