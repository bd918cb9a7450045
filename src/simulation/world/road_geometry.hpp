#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "simulation/recorded_path.hpp"

namespace ground_scale_vo::simulation {

/// Speed bumps along the road: length, begin of the first one, distance from one begin to the next
/// [m].
constexpr double kBumpLength = 3.6, kFirstBump = 21, kBumpSpacing = 17;

/// Plan and profile of the road: recorded, or generated from the other members. Positions are
/// lengths along the road [m].
struct RoadShape {
  double curvature = 0;                      ///< largest [1/m]
  double slope = 0;                          ///< largest of the long waves [m/m]
  double ramp_slope = 0;                     ///< of one straight ramp [m/m]; 0: none
  double ramp_begin = 0;                     ///< of its first transition
  double ramp_end = 0;                       ///< of its last transition
  double bump_height = 0;                    ///< of the speed bumps [m]; 0: none
  double shift = 0;                          ///< by which curves and waves lie nearer to the start
  std::shared_ptr<const RecordedPath> path;  ///< nullptr: a generated road
};

/// A recorded path may cross itself or return to a street that it has left, at another elevation.
/// So only a section of such a road exists for a camera, from kSectionBehind to kSectionAhead of
/// it, and only what stands in the way of a section is left out.
constexpr double kSectionBehind = 40, kSectionAhead = 240;  // [m]

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
  bool isRecorded() const { return shape_.path != nullptr; }
  /// Whether what stands at s exists for a camera at `camera_s`; always on a generated road.
  bool isInSection(double s, double camera_s) const;
  /// Distance in the plan from p, which lies beside the road at s, to the middle of the lane [m];
  /// of a recorded road, to its part that can be in one section with s.
  double distanceToLane(double s, const Eigen::Vector3d& p) const;
  /// The same to the lane of a recorded road 20 m or more before or after s; infinite on a
  /// generated road.
  double distanceToOtherLanes(double s, const Eigen::Vector3d& p) const;
  /// World from road: x along the road, y left, z normal to the surface, the origin on it at (s,
  /// u).
  Eigen::Isometry3d surfaceFrame(double s, double u) const;

 private:
  double elevation(double s) const;  // [m]
  double slope(double s) const;      // d(elevation)/ds
  double turned(double s) const;     // heading against that of the unshifted road at s = 0 [rad]
  double squaredDistance(const Eigen::Vector3d& p, double s_from, double s_to) const;
  const RoadShape shape_;
  double s_begin_, s_end_;
  std::vector<Eigen::Vector2d> nodes_;  // of the lane in the plan, every kNodeSpacing
};

}  // namespace ground_scale_vo::simulation
