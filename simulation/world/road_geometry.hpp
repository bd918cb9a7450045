#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <vector>

#include "simulation/synthetic_drive.hpp"
#include "simulation/world/recorded_path.hpp"

namespace gsv::simulation {

/// Speed bumps along the road: length, begin of the first one, distance from one begin to the next
/// [m].
constexpr double kBumpLength = 3.6, kFirstBump = 21, kBumpSpacing = 17;

// Extent of the road [m]: behind the rearmost position of the camera, ahead of the foremost one
// (also behind, if it looks back); and the longest drive, unless its path is recorded
// (RecordedPath).
constexpr double kRoadBehind = 25, kRoadAhead = 190, kMaxDriveLength = 3000;

// The cross-section of the street: lateral offsets u [m] from the middle of the right lane,
// positive to the left. Cars park between the right lane and the right kerb.
constexpr double kRightPavement = -6.3;  // outer border
constexpr double kRightKerb = -4.3;
constexpr double kRightLine = -1.9;
constexpr double kCentreLine = 1.75;
constexpr double kLeftLine = 5.35;
constexpr double kLeftKerb = 5.6;
constexpr double kLeftPavement = 7.8;  // outer border
constexpr double kKerbStoneWidth = 0.18;

// The texture of the road covers carriageway, kerbs, pavements and the edge of the verges.
// Across the road the texture unrolls the cross-section: the vertical faces of the kerbs take
// kKerbFace each, whatever the height of the kerbs.
constexpr double kKerbFace = 0.12;
constexpr double kRoadTexel = 0.02;     // [m]
constexpr int kRoadColumns = 896;       // 17.92 m
constexpr double kTextureRight = -8.2;  // right edge: u of column 0
constexpr double kTextureLeft = kTextureRight + kRoadColumns * kRoadTexel -
                                2 * kKerbFace;  // left edge: one past the last column

/// A recorded path may cross itself or return to a street that it has left, at another elevation.
/// So only a section of such a road exists for a camera, from kSectionBehind to kSectionAhead of
/// it, and only what stands in the way of a section is left out.
constexpr double kSectionBehind = 40, kSectionAhead = 240;  // [m]

/// The surface of the road. s is the length along the lane of the camera in the plan [m], u the
/// offset to its left [m]. World axes: x along the road at s = 0, y left, z up. There is no camber:
/// all u of the carriageway at one s have the same elevation.
class RoadGeometry {
 public:
  /// Covers s in [s_begin, s_end]. options: must outlive the object. path: of the road; nullptr: a
  /// road generated from the options.
  RoadGeometry(const SyntheticDrive::Options& options, std::shared_ptr<const RecordedPath> path,
               double s_begin, double s_end);

  double sBegin() const { return s_begin_; }
  double sEnd() const { return s_end_; }
  double heading(double s) const;    ///< of the lane in the plan, positive to the left [rad]
  double curvature(double s) const;  ///< d(heading)/ds [1/m]
  /// The point z above the surface [m].
  Eigen::Vector3d surfacePoint(double s, double u, double z = 0) const;
  double lowestElevation() const;  ///< [m]
  bool isRecorded() const { return path_ != nullptr; }
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
  /// Coordinates (across, along) in the texture of the road [m].
  Eigen::Vector2d textureUv(double s, double u) const {
    const double kerbs = (u >= kRightKerb ? kKerbFace : 0) + (u >= kLeftKerb ? kKerbFace : 0);
    return {u - kTextureRight + kerbs, s - s_begin_};
  }

 private:
  double elevation(double s) const;  // [m]
  double slope(double s) const;      // d(elevation)/ds
  double turned(double s) const;     // heading against that of the unshifted road at s = 0 [rad]
  double squaredDistance(const Eigen::Vector3d& p, double s_from, double s_to) const;
  const SyntheticDrive::Options& options_;
  const std::shared_ptr<const RecordedPath> path_;
  double s_begin_, s_end_;
  std::vector<Eigen::Vector2d> nodes_;  // of the lane in the plan, every kNodeSpacing
};

}  // namespace gsv::simulation
