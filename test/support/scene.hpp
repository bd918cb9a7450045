#pragma once

#include <Eigen/Geometry>
#include <random>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"
#include "vo/map.hpp"

namespace gsv::test {

inline PinholeCamera testCamera() { return {800, 248, 464, 464, 391, 119}; }
inline const PinholeCamera kCamera = testCamera();

/// rotation: rotation vector [rad].
inline Eigen::Isometry3d pose(const Eigen::Vector3d& rotation, const Eigen::Vector3d& translation) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  if (rotation.norm() > 0) {
    T.linear() = Eigen::AngleAxisd(rotation.norm(), rotation.normalized()).matrix();
  }
  T.translation() = translation;
  return T;
}

/// Angle of the relative rotation [rad].
inline double angleBetween(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return Eigen::Quaterniond(a).angularDistance(Eigen::Quaterniond(b));
}
inline double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return angleBetween(Eigen::Matrix3d(a.linear()), Eigen::Matrix3d(b.linear()));
}

/// Random points in front of a camera at the origin (optical axis z), depth 5 to 40 units.
inline std::vector<Eigen::Vector3d> randomPoints(int n, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> x(-0.7, 0.7), y(-0.22, 0.22), z(5, 40);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) {
    const double depth = z(generator);
    const double sx = x(generator), sy = y(generator);
    points.emplace_back(depth * sx, depth * sy, depth);
  }
  return points;
}

/// Random points on a road plane 1.65 units below the same camera.
inline std::vector<Eigen::Vector3d> roadPoints(int n, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> x(-5, 5), z(7, 30);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) {
    const double depth = z(generator);
    const double side = x(generator);
    points.emplace_back(side, 1.65, depth);
  }
  return points;
}

/// Normalised image coordinates of a point.
inline Eigen::Vector2d normalised(const Eigen::Vector3d& p_c) { return p_c.head<2>() / p_c.z(); }

/// Standard deviation of an observation in normalised image coordinates: 0.37 px of testCamera().
constexpr double kObservationSigma = 0.0008;

/// Pose of keyframe k on a gentle curve.
inline Eigen::Isometry3d keyframePose(int k) {
  return pose({0, 0.01 * k, 0}, {0.1 * k, 0, 0.8 * k});
}

/// Random points in front of the camera at keyframes 0 to 13 of that trajectory, depth 17 to 52
/// units from the first.
inline std::vector<Eigen::Vector3d> farPoints(int n) {
  auto points = randomPoints(n, 21);
  for (auto& p : points) p.z() += 12;
  return points;
}

/// Noise-free observations of all points in a keyframe, also of those outside the image; the id is
/// the point's index.
inline std::vector<Observation> observe(const std::vector<Eigen::Vector3d>& points,
                                        const Eigen::Isometry3d& T_w_c) {
  std::vector<Observation> corners;
  for (std::size_t i = 0; i < points.size(); ++i) {
    corners.push_back({i, normalised(T_w_c.inverse() * points[i]), kObservationSigma});
  }
  return corners;
}

}  // namespace gsv::test
