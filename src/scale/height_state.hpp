#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <deque>
#include <optional>

#include "ground_scale_vo/scale/scale_options.hpp"

namespace gsv {

/// The Kalman filter of ScaleFilter: a random walk of ln h, the height of the camera in VO units,
/// and the offsets of the measured heights from it. With a given camera height h* [m] and no
/// speeds, ln h* and the factor of the speeds are constant.
class HeightState {
 public:
  enum Index { kHeight, kTilt, kKerb, kCameraHeight, kSpeedFactor, kStates };
  /// ln h, tilt of a young map [rad], kerb, ln h* by the prior, ln of the factor of the speeds.
  using Vector = Eigen::Matrix<double, kStates, 1>;
  using Matrix = Eigen::Matrix<double, kStates, kStates>;

  /// What is known before the first measurement.
  struct Prior {
    double camera_height = 0;        ///< h* [m]; not positive: not known
    double camera_height_sigma = 0;  ///< standard deviation [m]
    double speed_scale_sigma = 0;    ///< relative, of the factor of the speeds
  };

  HeightState(const ScaleFilterOptions& options, const Prior& prior);

  /// Another map: only the camera height and the factor of the speeds are kept.
  void startMap();
  /// From a measurement with the Jacobian H. turned: rotation since the start of the map [rad].
  void start(double log_height, double variance, const Vector& H, double turned = 0);
  /// From a speed: h follows as accurately as h* is known. log_scale: ln of metres per VO unit.
  void startFromSpeed(double log_scale, double variance);
  /// For the moving average, instead of correct().
  void set(double log_height, double variance);
  /// distance: travelled [VO units]; metres_per_unit: 0: not known; angle: rotated [rad];
  /// k1_sigma: PinholeCamera::k1Sigma() of the lens.
  void predict(double distance, double metres_per_unit, double angle, double k1_sigma);
  /// Another lens: heights differ a little from now on.
  void changeLens();
  void correct(const Vector& H, double innovation, double variance);

  /// Rauch-Tung-Striebel step: this state with what later measurements say. predicted: the state
  /// that followed from this one; next: the same after all measurements.
  HeightState smoothed(const HeightState& predicted, const HeightState& next) const;

  /// The prediction of a measurement with the Jacobian H, and its variance.
  double predicted(const Vector& H) const { return H.dot(state_); }
  double variance(const Vector& H) const { return H.dot(covariance_ * H); }
  double operator[](Index i) const { return state_[i]; }
  double height() const { return std::exp(state_[kHeight]); }  ///< h [VO units]
  double cameraHeight() const { return prior_height_ * std::exp(state_[kCameraHeight]); }
  double cameraHeightSigma() const;
  bool hasCameraHeight() const;  ///< well enough for a scale from the road alone
  /// ln of metres per VO unit as a measurement: the Jacobian for predicted() - ln of the prior
  /// height, with the factor of the speeds.
  static Vector speedJacobian();
  double speedInnovation(double log_scale) const;
  /// Relative standard deviation of h*/h. nis_scale: factor on the variance. The NIS of planes
  /// contains nothing of the camera height and the factor of the speeds, so what these contribute
  /// is not scaled.
  double scaleSigma(double nis_scale) const;

 private:
  ScaleFilterOptions options_;
  double prior_height_;           ///< [m]
  double height_variance_limit_;  ///< of ln h*
  Vector state_ = Vector::Zero();
  Matrix covariance_ = Matrix::Zero();
  double kerb_kept_ = 1;  ///< factor on the kerb of the latest predict()
};

/// The latest consecutive measurements that the filter has rejected. When they agree over a
/// sufficient distance, the filter is wrong and restarts from them.
class ContradictingRun {
 public:
  struct Sample {
    double value = 0, variance = 0;
  };

  /// distance, turned: travelled [VO units] and rotated [rad] so far.
  void add(const Sample& sample, double distance, double turned);
  void clear() { samples_.clear(); }
  bool empty() const { return samples_.empty(); }
  double latest() const { return samples_.back().value; }
  double since() const { return since_; }          ///< distance at the first
  double turnedBefore() const { return turned_; }  ///< rotation at the first
  /// Their median with the mean variance; empty while there are too few, or one deviates by more
  /// than max_deviation.
  std::optional<Sample> agreement(double max_deviation) const;

 private:
  std::deque<Sample> samples_;
  double since_ = 0, turned_ = 0;
};

}  // namespace gsv
