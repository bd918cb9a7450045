#pragma once

#include "ground_scale_vo/scale/scale_options.hpp"
#include "scale/camera_path.hpp"
#include "scale/road.hpp"

namespace ground_scale_vo {

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

  double pitch() const { return pitchOf(mean_.n_c); }  ///< [rad], positive: the camera looks down
  /// [rad], positive: the camera's x axis points down
  double roll() const { return rollOf(mean_.n_c); }
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
  /// Gaussian on the unit sphere.
  struct Normal {
    Eigen::Vector3d n_c = Eigen::Vector3d(0, -1, 0);  ///< unit
    /// Of rotations of n_c, in its tangent plane: rank 2, covariance * n_c = 0 [rad^2].
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();

    double variance(const Eigen::Vector3d& axis) const { return axis.dot(covariance * axis); }
    /// Kalman update with a measured tilt towards axis (unit, orthogonal to n_c), given as its
    /// tangent.
    void update(const Eigen::Vector3d& axis, double tangent, double measurement_variance);
    void set(const Eigen::Vector3d& n_c);
  };
  void addSample(const Eigen::Vector3d& axis, double tangent, double sample_sigma,
                 double step_heights);
  void limitTilt();

  Options options_;
  Normal mean_;
};

}  // namespace ground_scale_vo
