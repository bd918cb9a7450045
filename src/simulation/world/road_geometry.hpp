#pragma once

#include <Eigen/Geometry>
#include <vector>

namespace ground_scale_vo::simulation {

/// Speed bumps along the road: length, begin of the first one, distance from one begin to the next
/// [m].
constexpr double kBumpLength = 3.6, kFirstBump = 21, kBumpSpacing = 17;

/// Plan and profile of the road. Positions are lengths along the road [m].
struct RoadShape {
  double curvature = 0;    ///< largest [1/m]
  double slope = 0;        ///< largest of the long waves [m/m]
  double ramp_slope = 0;   ///< of one straight ramp [m/m]; 0: none
  double ramp_begin = 0;   ///< of its first transition
  double ramp_end = 0;     ///< of its last transition
  double bump_height = 0;  ///< of the speed bumps [m]; 0: none
  double shift = 0;        ///< by which curves and waves lie nearer to the start
};

/// The surface of the road. s is the length along the lane of the camera in the plan [m], u the
/// offset to its left [m]. World axes: x along the road at s = 0, y left, z up. There is no camber:
/// all u of the carriageway at one s have the same elevation.
class RoadGeometry {
 public:
  /// Covers s in [s_begin, s_end].
  RoadGeometry(const RoadShape& shape, double s_begin, double s_end);

  double sBegin() const { return s_begin_; }
  double sEnd() const { return s_end_; }
  double heading(double s) const;    ///< of the lane in the plan, positive to the left [rad]
  double curvature(double s) const;  ///< d(heading)/ds [1/m]
  /// The point z above the surface [m].
  Eigen::Vector3d surfacePoint(double s, double u, double z = 0) const;
  double lowestElevation() const;  ///< [m]
  /// Distance in the plan from p to the middle of the lane [m].
  double distanceToLane(const Eigen::Vector3d& p) const;
  /// World from road: x along the road, y left, z normal to the surface, the origin on it at (s,
  /// u).
  Eigen::Isometry3d surfaceFrame(double s, double u) const;

 private:
  double elevation(double s) const;  // [m]
  double slope(double s) const;      // d(elevation)/ds
  double turned(double s) const;     // heading against that of the unshifted road at s = 0 [rad]
  const RoadShape shape_;
  double s_begin_, s_end_;
  std::vector<Eigen::Vector2d> nodes_;  // of the lane in the plan, every kNodeSpacing
};

}  // namespace ground_scale_vo::simulation
