#pragma once

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/camera_path.hpp"
#include "ground_scale_vo/scale/road.hpp"

namespace ground_scale_vo {

/// The road's normal in camera axes when the vehicle is level on it, as a slow average: its tilt
/// along the path from the direction of motion, which on average is parallel to the road (Eq. 3),
/// and its tilt across the path from the estimated planes. The camera may look in any horizontal
/// direction. For a forward-facing camera the two tilts are pitch and roll of the mounting.
/// The paper assumes a pitch of zero; an error of 1 degree is 11 % of the height for a point 10 m
/// ahead.
class Mounting {
 public:
  /// Names ending in _heights: camera heights; other sigmas: standard deviations in rad.
  struct Options {
    double initial_pitch_sigma = 0.1;
    double initial_roll_sigma = 0.1;
    double pitch_motion_sigma = 0.012;
    double heave_sigma_heights = 0.02;
    double chord_length_heights = 3;
    double forgetting_distance_heights = 200;
    double max_tilt_rad = 0.5;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("initial_pitch_sigma", self.initial_pitch_sigma, 1e-4, 1,
            "[rad] standard deviation of the initial pitch, which is zero");
      visit("initial_roll_sigma", self.initial_roll_sigma, 1e-4, 1,
            "[rad] standard deviation of the initial roll, which is zero");
      visit("pitch_motion_sigma", self.pitch_motion_sigma, 1e-4, 1,
            "[rad] standard deviation of the vehicle's pitch against the road (braking, crests)");
      visit(
          "heave_sigma_heights", self.heave_sigma_heights, 1e-5, 1,
          "[camera heights] standard deviation of the vertical motion against the road between the "
          "ends of a chord");
      visit("chord_length_heights", self.chord_length_heights, 0.01, 1000,
            "[camera heights] length of the chord that defines the direction of motion");
      visit("forgetting_distance_heights", self.forgetting_distance_heights, 1, 1e6,
            "[camera heights] averaging length of pitch and roll");
      visit("max_tilt_rad", self.max_tilt_rad, 0.001, 0.8, "[rad] bound of pitch and roll");
    }
    /// Throws OptionError.
    void validate() const;
  };

  /// Throws OptionError.
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
