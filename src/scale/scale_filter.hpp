#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <optional>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"

namespace ground_scale_vo {

/// Kalman filter of the camera height h in VO units (the paper's section III.C;
/// the scale is h*/h). The height is filtered and not the scale of single frames, because with a
/// local map neighbouring frames share one unit of length.
///
/// State: ln h, and the tilt of the young map: its first views have a short baseline, so all its
/// points are turned about the camera by the same small angle, which raises or lowers the road in
/// proportion to its distance. The tilt vanishes as the map grows. Third, the kerb: where the lane
/// has too few corners, the points lie on kerbs and pavements beside it, and the height above these
/// is another one than that above the lane. Direct measurements, which see the lane alone, teach
/// the difference; without them it remains an uncertainty of h. Process: a random walk of ln h in
/// the distance travelled and the rotation. Measurements: ln of a measured height, from one or two
/// sources per frame, with a gate on the normalised innovation squared (NIS). Neighbouring
/// measurements of a source see the same road and are correlated, so their information is weighted
/// by the distance between them; the result does not depend on the frame rate. With an estimated
/// lens the unit of length is steadier in turns, and feature-based measurements count less while
/// direct ones are accepted.
///
/// With a speed of the vehicle two more states are known only roughly: ln of the camera height h*
/// [m], and ln of the factor by which the speed is too large. Planes measure ln h, speeds measure
/// ln(h*/h) plus the factor. Both states outlast a map. Without a speed, and with a given h*, they
/// are constant and the filter is that of the paper.
///
/// The square of scaleSigma() is multiplied by the mean NIS of the latest measurements, accepted or
/// not, which adapts it to the camera and the road (NIS scaling). The NIS does not influence the
/// gain.
class ScaleFilter {
 public:
  enum class Source : std::uint8_t {
    kFeatureBased = 0,  ///< plane fitted to the ground points
    kDirect = 1         ///< plane estimated from image intensities
  };
  using Options = ScaleFilterOptions;

  /// What is known before the first measurement.
  struct Prior {
    double camera_height = 0;        ///< h* [m]; not positive: not known
    double camera_height_sigma = 0;  ///< standard deviation [m]
    double speed_scale_sigma = 0;    ///< relative, of the factor of the speeds
  };

  /// Throws OptionError.
  ScaleFilter(const Options& options, const Prior& prior);

  /// Another map: only the camera height and the factor of the speeds are kept.
  void startMap();

  /// Prediction step. distance: travelled since the last call [VO units], >= 0; angle: rotated
  /// since then [rad], >= 0.
  void predict(double distance, double angle);

  /// Update step with a measured height, its standard deviation, and the distance of the measured
  /// road from the camera [VO units], at most one per source and frame. is_beside_lane: above the
  /// ground beside the lane. True when it passed the gate or started the filter. Ignored, with
  /// false: a value that is negative or not finite, a height of zero, and a measurement before
  /// start_distance_heights.
  bool update(double height, double sigma, double road_distance,
              Source source = Source::kFeatureBased, bool is_beside_lane = false);

  /// Update step with a speed: the ratio of the distance [m] that followed from it to the one of
  /// the odometry [VO units], and its relative standard deviation. True when it passed the gate or
  /// started the filter. Precondition: both positive and finite.
  bool updateSpeed(double metres_per_unit, double relative_sigma);

  bool known() const;            ///< the scale is known
  bool heightKnown() const;      ///< height() is: not yet, with a speed but no h* and no plane
  double height() const;         ///< h [VO units]; 0 while not heightKnown()
  double scale() const;          ///< h*/h [m per VO unit]; 0 while not known()
  double scaleSigma() const;     ///< standard deviation of scale(); 0 while not known()
  bool hasCameraHeight() const;  ///< cameraHeight() is given or learned
  double cameraHeight() const {
    return prior_height_ * std::exp(state_[kCameraHeight]);
  }                                  ///< h* [m]
  double cameraHeightSigma() const;  ///< standard deviation of cameraHeight() [m]

  /// Whether the lens of the images was estimated from drives. Before predict().
  void setLensIsEstimated(bool is_estimated) { lens_is_estimated_ = is_estimated; }
  /// A refined lens replaces the one of the images so far.
  void changeLens();

 private:
  enum State { kHeight, kTilt, kKerb, kCameraHeight, kSpeedFactor, kStates };
  using StateVector = Eigen::Matrix<double, kStates, 1>;
  using StateMatrix = Eigen::Matrix<double, kStates, kStates>;
  struct Measurement {
    double log_height;
    double variance;
    double road_distance;  ///< [camera heights]
    bool is_beside_lane = false;
  };
  struct SourceState {
    double accepted_at = 0;  ///< distance_ at the latest accepted measurement; 0: none
    double measured_at = 0;  ///< distance_ at the latest measurement
    /// The latest consecutive rejected measurements, at most restart_measurements: candidates for a
    /// restart.
    std::deque<Measurement> pending;
    double pending_since = 0, turned_before = 0;  ///< distance_, turned_ at the first
  };
  bool updateMovingAverage(double height, double variance);
  bool restart(const Measurement& measurement, SourceState* source);
  void start(const Measurement& measurement);
  bool restartFromSpeed(double log_scale, double variance);
  void startFromSpeed(double log_scale, double variance);
  void correct(const StateVector& H, double innovation, double variance);
  bool isDirectAccepted();
  void clearPending(Source source);
  void updateNisScale(double nis, SourceState* source);
  StateVector jacobianOf(const Measurement& measurement) const;
  double tiltLever(const Measurement& measurement) const;
  SourceState& stateOf(Source source) { return sources_[static_cast<std::size_t>(source)]; }

  Options options_;
  double prior_height_;           ///< [m]
  double height_variance_limit_;  ///< of ln h*
  bool started_ = false;
  bool has_plane_ = false, has_speed_ = false;  ///< accepted one since the start
  bool lens_is_estimated_ = false;
  /// ln h, tilt [rad], kerb, ln h* by prior_height_, ln of the factor of the speeds.
  StateVector state_ = StateVector::Zero();
  StateMatrix covariance_ = StateMatrix::Zero();
  double distance_ = 0;      ///< travelled [VO units]
  double turned_ = 0;        ///< rotated [rad]
  double started_at_ = 0;    ///< distance_ at the latest (re)start
  double tilted_since_ = 0;  ///< distance_ from which on the tilt decays
  double nis_scale_ = 1;     ///< mean normalised innovation squared
  std::array<SourceState, 2> sources_;
  std::deque<double> inverse_heights_;       ///< of the moving average
  std::deque<double> pending_speeds_;        ///< consecutive rejected ones: ln of the ratio
  double pending_speeds_since_ = 0;          ///< distance_ at the first
  std::optional<double> speed_accepted_at_;  ///< distance_ at the latest accepted speed
};

}  // namespace ground_scale_vo
