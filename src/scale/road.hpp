#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <string>

#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"

namespace gsv {

class CameraPath;

/// The road's normal in camera axes for a mounting with this pitch and roll [rad]; unit, up.
Eigen::Vector3d roadNormal(double pitch, double roll);
/// The inverse [rad]: of a unit normal in camera axes.
double pitchOf(const Eigen::Vector3d& n_c);
double rollOf(const Eigen::Vector3d& n_c);
/// Axes of the road in camera axes, the columns of a rotation: ahead, left, up. n_c: unit normal,
/// up. Ahead is the part of direction_c (default: the viewing direction) that is parallel to the
/// road.
Eigen::Matrix3d roadAxes(const Eigen::Vector3d& n_c,
                         const Eigen::Vector3d& direction_c = Eigen::Vector3d::UnitZ());

/// Straight line between two camera positions of the path: the direction of motion averaged over a
/// distance, for Eq. 3. The direction t_{t,t-1} of single frames varies by half a degree with the
/// vehicle's vibration, the direction of a chord over several frames does not.
struct Chord {
  Eigen::Vector3d direction_c = Eigen::Vector3d::Zero();  ///< unit, along the motion, camera axes
  double length = 0;                                      ///< VO units, > 0
  Eigen::Vector3d turn_c = Eigen::Vector3d::Zero();  ///< rotation from its start to its end [rad]
};

/// Normal equations H x = b.
template <int kUnknowns>
struct NormalEquations {
  Eigen::Matrix<double, kUnknowns, kUnknowns> H =
      Eigen::Matrix<double, kUnknowns, kUnknowns>::Zero();
  Eigen::Matrix<double, kUnknowns, 1> b = Eigen::Matrix<double, kUnknowns, 1>::Zero();
};

/// What mounting and motion tell about the road in one frame, before it is measured.
struct RoadPrior {
  Eigen::Vector3d n_c = Eigen::Vector3d(0, -1, 0);       ///< unit, up
  Eigen::Vector3d forward_c = Eigen::Vector3d(0, 0, 1);  ///< unit, orthogonal to n_c
  double pitch_sigma = 0;      ///< standard deviation about lateral() [rad]
  double roll_sigma = 0;       ///< standard deviation about forward_c [rad]
  std::optional<Chord> chord;  ///< ends at this frame; empty: no motion yet
  /// Lateral position, to the left of the path, of the middle of the region in which the road is
  /// measured [camera heights]. 0: on the path.
  double region_offset = 0;

  Eigen::Vector3d lateral() const { return n_c.cross(forward_c); }  ///< unit, to the left
  /// The axes of the road in camera axes, the columns of a rotation: ahead, left, up.
  Eigen::Matrix3d axes() const {
    return (Eigen::Matrix3d() << forward_c, lateral(), n_c).finished();
  }
  /// Largest plausible pitch and roll of a plane against n_c [rad]: the tolerance [rad], and three
  /// standard deviations of the prior added in quadrature.
  double pitchTolerance(double tolerance) const { return std::hypot(tolerance, 3 * pitch_sigma); }
  double rollTolerance(double tolerance) const { return std::hypot(tolerance, 3 * roll_sigma); }
  /// Adds pitch and roll as measurements to the normal equations H x = b of a correction x of
  /// m = n / h. height: [VO units].
  void addTo(const Eigen::Vector3d& m, double height,
             Eigen::Ref<Eigen::Matrix3d, 0, Eigen::OuterStride<>> H,
             Eigen::Ref<Eigen::Vector3d> b) const;
};

/// Lane-shaped region of the visible road: a band of constant width on the expected plane, with the
/// curvature of the driven path, ahead of the vehicle and behind it. Lengths are in camera heights,
/// so the region is defined before the height is known.
class LaneRegion {
 public:
  /// height: of the camera [VO units], converts the length of the prior's chord, which gives the
  /// curvature; 0 (not known): the region is straight. In camera heights: min_distance from the
  /// point on the road below the camera, max_ahead along the path in both directions, and
  /// half_width of the band.
  LaneRegion(const RoadPrior& prior, double height, double min_distance, double max_ahead,
             double half_width);

  /// Whether a viewing ray (camera axes, z = 1) meets the plane in the region.
  bool contains(const Eigen::Vector3d& ray) const;

 private:
  Eigen::Matrix3d R_c_road_;  ///< columns: ahead, left, up
  double offset_, min_distance_, max_ahead_, half_width_;
  double curvature_ = 0;     ///< to the left [1 / camera height]
  double chord_length_ = 0;  ///< [camera heights]; the chord runs from ahead = -chord_length_ to 0
};

/// RoadPrior::region_offset for a prior: 0 while a reasonable part of the path is in the image. A
/// camera that looks sideways does not see the path; its region is the band beside the path that is
/// nearest to it and well visible.
double visibleRegionOffset(const PinholeCamera& camera, const RoadPrior& prior);

/// The road's normal in camera axes when the vehicle is level on it, as a slow average: its tilt
/// along the path from the direction of motion, which on average is parallel to the road (Eq. 3),
/// and its tilt across the path from the estimated planes. The camera may look in any horizontal
/// direction. For a forward-facing camera the two tilts are pitch and roll of the mounting.
/// The paper assumes a pitch of zero; an error of 1 degree is 11 % of the height for a point 10 m
/// ahead.
class Mounting {
 public:
  using Options = MountingOptions;

  explicit Mounting(const Options& options);

  double pitch() const { return pitchOf(n_c_); }  ///< [rad], positive: the camera looks down
  /// [rad], positive: the camera's x axis points down
  double roll() const { return rollOf(n_c_); }
  /// Standard deviation of the normal in the direction in which it is known least [rad].
  double sigma() const;

  /// Prior for the newest camera of the path: the mounting's normal, corrected towards
  /// orthogonality to the direction of motion (Eq. 3) by the ratio of their variances.
  /// height: of the camera [VO units]; 0 when it is not known.
  RoadPrior prior(const CameraPath& path, double height) const;

  /// Updates the average with one frame. prior: of this frame. plane: its accepted plane, or null.
  /// step: distance since the last update; height: of the camera [VO units], > 0.
  void update(const RoadPrior& prior, const GroundPlane* plane, double step, double height);

 private:
  double variance(const Eigen::Vector3d& axis) const { return axis.dot(covariance_ * axis); }
  void correct(const Eigen::Vector3d& axis, double tangent, double measurement_variance);
  void setNormal(const Eigen::Vector3d& n_c);
  void addSample(const Eigen::Vector3d& axis, double tangent, double sample_sigma,
                 double step_heights);
  void limitTilt();

  Options options_;
  // Gaussian on the unit sphere.
  Eigen::Vector3d n_c_ = Eigen::Vector3d(0, -1, 0);  ///< unit
  /// Of rotations of n_c_, in its tangent plane: rank 2, covariance_ * n_c_ = 0 [rad^2].
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();
};

/// A YAML file with the parameter camera_height [m]; error95: half width of its 95 % interval.
/// source: from what it is known.
std::string heightYaml(const std::string& source, double height, double error95);

/// The lines of such a file, comments, with pitch and roll of the camera's mounting [rad], their 95
/// % intervals, and its transform for tf.
std::string mountingComments(double height, double pitch, double pitch95, double roll,
                             double roll95);

}  // namespace gsv
