#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"
#include "scale/road.hpp"

namespace gsv {

/// A flat road with map points and a camera that drives straight over it: exact VoFrames in any VO
/// unit.
/// Road axes: x right, y down, z ahead, origin below the first camera.
struct RoadScene {
  PinholeCamera camera{620, 188, 359.0, 359.0, 310.0, 92.0};
  double height = 0.7;                  ///< of the camera [VO units]
  double pitch = 0.02;                  ///< [rad] positive looks down
  double roll = 0;                      ///< [rad] positive: the camera's x axis points down
  double yaw = 0;                       ///< [rad] positive: the camera looks to the left
  double step = 0.4;                    ///< per frame [VO units]
  double depth_noise = 0;               ///< relative, of the inverse depth; constant for each point
  double depth_sigma = 0.02;            ///< reported standard deviation of the depth, relative
  std::vector<Eigen::Vector3d> points;  ///< road axes [VO units]; id = index + 1

  /// n random points in a rectangle parallel to the road; y: road 0, above it negative [VO units].
  void addPatch(int n, double x_min, double x_max, double z_min, double z_max, double y,
                unsigned seed) {
    std::mt19937 random(seed);
    const auto uniform = [&](double a, double b) {
      return a + (b - a) * static_cast<double>(random()) / 4294967296.0;
    };
    for (int i = 0; i < n; ++i)
      points.emplace_back(uniform(x_min, x_max), y, uniform(z_min, z_max));
  }
  /// n random points on a wall across the road at z (the back of a vehicle), from the road to the
  /// height top [VO units].
  void addWall(int n, double x_min, double x_max, double top, double z, unsigned seed) {
    addPatch(n, x_min, x_max, -top, 0, 0, seed);
    for (auto p = points.end() - n; p != points.end(); ++p) *p = {p->x(), p->z(), z};
  }

  /// Approximately standard normal error of point i, from a hash of i.
  static double normalErrorOf(std::size_t i) {
    std::uint64_t state = i + 1;
    double sum = -6;
    for (int k = 0; k < 12; ++k) {
      state = (state ^ (state >> 29)) * 0xBF58476D1CE4E5B9ull + 0x9E3779B97F4A7C15ull;
      sum += static_cast<double>(state >> 11) * 0x1p-53;
    }
    return sum;
  }

  /// R_road_c.
  Eigen::Matrix3d rotation() const {
    return (Eigen::AngleAxisd(-yaw, Eigen::Vector3d::UnitY()) *
            Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()) *
            Eigen::AngleAxisd(-pitch, Eigen::Vector3d::UnitX()))
        .toRotationMatrix();
  }
  /// Normal of the road in camera axes, pointing up.
  Eigen::Vector3d normal() const { return rotation().transpose() * Eigen::Vector3d(0, -1, 0); }

  /// Frame of the camera at distance `at` along the road [VO units].
  VoFrame frameAt(std::uint32_t sequence, double at) const {
    VoFrame frame;
    frame.sequence = sequence;
    frame.stamp_ns = 1000000000ll + 100000000ll * static_cast<std::int64_t>(sequence);
    frame.status = VoStatus::kTracking;
    frame.camera = camera;
    const Eigen::Matrix3d R_r_c = rotation();
    frame.T_w_c.translation() = R_r_c.transpose() * Eigen::Vector3d(0, 0, at);
    const Eigen::Vector3d centre_r(0, -height, at);
    for (std::size_t i = 0; i < points.size(); ++i) {
      Eigen::Vector3d p = R_r_c.transpose() * (points[i] - centre_r);
      if (!(p.z() > 0.1 * height)) continue;
      const Eigen::Vector2d u = camera.project(p);
      if (u.x() < 0 || u.y() < 0 || u.x() > camera.width - 1 || u.y() > camera.height - 1) continue;
      p /= 1 + depth_noise * normalErrorOf(i);
      TrackedFeature feature;
      feature.id = i + 1;
      feature.age = 5;
      feature.u = u.cast<float>();
      feature.has_point = true;
      feature.p_c = p.cast<float>();
      feature.depth_sigma = static_cast<float>(depth_sigma * p.z());
      frame.features.push_back(feature);
    }
    return frame;
  }
  /// Frame of a camera that has moved by `step` in every frame.
  VoFrame frame(std::uint32_t sequence) const { return frameAt(sequence, step * sequence); }
};

/// Default options and the camera height, which is required: that of KITTI.
inline ScaleRecovery::Options recoveryOptions() {
  ScaleRecovery::Options o;
  o.camera_height = 1.65;
  return o;
}

/// The scene in another VO unit.
inline RoadScene inUnit(double unit, RoadScene scene) {
  for (Eigen::Vector3d& point : scene.points) point *= unit;
  scene.height *= unit;
  scene.step *= unit;
  return scene;
}

/// Prior with the scene's normal and direction of motion, without a chord. sigma: of pitch and roll
/// [rad].
inline RoadPrior priorOf(const RoadScene& scene, double sigma = 0.01) {
  RoadPrior prior;
  prior.n_c = scene.normal();
  prior.forward_c = scene.rotation().transpose() * Eigen::Vector3d::UnitZ();
  prior.pitch_sigma = prior.roll_sigma = sigma;
  return prior;
}

}  // namespace gsv
