#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace ground_scale_vo::synthetic {

constexpr double kPi = 3.14159265358979323846;

/// Speed bumps: their length along the road, where the first one begins, from one to the next [m].
constexpr double kBumpLength = 3.6, kBumpAt = 21, kBumpSpacing = 17;

/// Small seeded generator (SplitMix64), the same numbers with every standard library.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits();
  double uniform(double from, double to);
  bool chance(double probability) { return uniform(0, 1) < probability; }

 private:
  std::uint64_t state_;
};

/// What the road does in the plan and in height. Lengths along the road [m].
struct RoadShape {
  double curvature = 0;    ///< largest [1/m]
  double slope = 0;        ///< largest of the long waves [m/m]
  double ramp_slope = 0;   ///< of one straight ramp [m/m]
  double ramp_from = 0;    ///< where its foot (or crest) begins
  double ramp_to = 0;      ///< where its other edge ends
  double bump_height = 0;  ///< of speed bumps across the road [m]
};

/// The road: s is the length along the camera's lane in the plan [m], u the offset to its left [m].
/// World axes: x along the road at s = 0, y left, z up. Without camber: at one s all u of the
/// carriageway have one height.
class Street {
 public:
  /// s in [from, to].
  Street(const RoadShape& shape, double from, double to);

  double from() const { return from_; }
  double to() const { return to_; }
  double heading(double s) const;    ///< of the lane in the plan [rad], to the left
  double curvature(double s) const;  ///< d(heading)/ds [1/m]
  /// On the surface, raised by z [m].
  Eigen::Vector3d point(double s, double u, double z = 0) const;
  double lowest() const;  ///< elevation [m]
  /// Distance in the plan from a place to the middle of the lane [m].
  double distance(const Eigen::Vector3d& p) const;
  /// Axes x along the road, y left, z normal to its surface; the origin on it at (s, u).
  Eigen::Isometry3d frame(double s, double u) const;

 private:
  double elevation(double s) const;
  double rise(double s) const;
  const RoadShape shape_;
  double from_, to_;
  std::vector<Eigen::Vector2d> nodes_;  ///< plan positions, every kStep
};

}  // namespace ground_scale_vo::synthetic
