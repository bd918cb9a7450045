#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/scale/scale_options.hpp"
#include "scale/height_state.hpp"

namespace gsv {

/// Filter of the camera height h in VO units (the paper's section III.C; the scale is h*/h):
/// decides which measurements the Kalman filter takes, and when they contradict it for so long that
/// it starts again. Planes measure ln h, speeds ln(h*/h). Neighbouring measurements of a source see
/// the same road, so their information is weighted by the distance between them. The square of
/// scaleSigma() is multiplied by the mean normalised innovation squared (NIS) of the latest
/// measurements, accepted or not. docs/explanation/how_it_works.md describes the model.
class ScaleFilter {
 public:
  using Options = ScaleFilterOptions;
  using Prior = HeightState::Prior;
  enum class Source : std::uint8_t {
    kFeatureBased = 0,  ///< plane fitted to the ground points
    kDirect = 1         ///< plane estimated from image intensities
  };

  ScaleFilter(const Options& options, const Prior& prior)
      : options_(options), state_(options, prior), predicted_(state_) {}

  /// Another map: only the camera height and the factor of the speeds are kept.
  void startMap();

  /// Prediction step. distance: travelled since the last call [VO units], >= 0; angle: rotated
  /// since then [rad], >= 0; k1_sigma: PinholeCamera::k1Sigma() of the lens.
  void predict(double distance, double angle, double k1_sigma);

  /// Update step with a measured height, its standard deviation, and the distance of the measured
  /// road from the camera [VO units], at most one per source and frame. is_beside_lane: above the
  /// ground beside the lane. True when it passed the gate or started the filter. Ignored, with
  /// false: a value that is negative or not finite, a height of zero, and a measurement before the
  /// map has the length of half a camera height.
  bool update(double height, double sigma, double road_distance,
              Source source = Source::kFeatureBased, bool is_beside_lane = false);

  /// Update step with a speed: the ratio of the distance [m] that followed from it to the one of
  /// the odometry [VO units], and its relative standard deviation. True when it passed the gate or
  /// started the filter. Precondition: both positive and finite.
  bool updateSpeed(double metres_per_unit, double relative_sigma);

  bool known() const;         ///< the scale is known
  bool heightKnown() const;   ///< height() is: not yet, with a speed but no h* and no plane
  double height() const;      ///< h [VO units]; 0 while not heightKnown()
  double scale() const;       ///< h*/h [m per VO unit]; 0 while not known()
  double scaleSigma() const;  ///< standard deviation of scale(); 0 while not known()
  /// cameraHeight() is given, or known from speeds.
  bool hasCameraHeight() const { return state_.hasCameraHeight(); }
  double cameraHeight() const { return state_.cameraHeight(); }            ///< h* [m]
  double cameraHeightSigma() const { return state_.cameraHeightSigma(); }  ///< [m]

  /// h* by the speeds [m]: cameraHeight(), or while consistent planes contradict the speeds, the
  /// height that these have by the scale.
  double heightBySpeeds() const;

  /// A refined lens replaces the one of the images so far.
  void changeLens();

  // For the smoother.
  const HeightState& predicted() const { return predicted_; }  ///< by the latest predict()
  const HeightState& state() const { return state_; }
  double distance() const { return distance_; }  ///< travelled in this map [VO units]
  double nisScale() const { return nis_scale_; }
  /// distance() from which on the state was wrong, when the latest update() replaced it.
  const std::optional<double>& wrongSince() const { return wrong_since_; }

 private:
  struct Measurement {
    double log_height;
    double variance;
    double road_distance;  ///< [camera heights]
    bool is_beside_lane = false;
  };
  /// Distances are those travelled in the map [VO units].
  struct SourceState {
    double accepted_distance = 0;  ///< at the latest accepted measurement; 0: none
    double measured_distance = 0;  ///< at the latest measurement
    ContradictingRun rejected;
  };
  bool updateMovingAverage(double height, double variance);
  bool restart(const Measurement& measurement, SourceState* source);
  bool restartFromSpeed(double log_scale, double variance);
  void start(const Measurement& measurement);
  void startFromSpeed(double log_scale, double variance);
  void started();
  bool isDirectAccepted();
  void clearRejected(Source source);
  void updateNisScale(double nis, SourceState* source);
  HeightState::Vector jacobianOf(const Measurement& measurement) const;
  SourceState& stateOf(Source source) { return sources_[static_cast<std::size_t>(source)]; }

  Options options_;
  HeightState state_;
  HeightState predicted_;
  std::optional<double> wrong_since_;
  bool started_ = false;
  bool has_plane_ = false, has_speed_ = false;  ///< accepted one since the start
  double k1_sigma_ = 0;                         ///< of the lens of the images
  double distance_ = 0;                         ///< travelled [VO units]
  double turned_ = 0;                           ///< rotated [rad]
  double start_distance_ = 0;                   ///< distance_ at the latest (re)start
  double start_turned_ = 0;                     ///< turned_ then
  double tilt_distance_ = 0;                    ///< distance_ from which on the tilt decays
  double nis_scale_ = 1;                        ///< mean normalised innovation squared
  std::array<SourceState, 2> sources_;
  std::deque<double> inverse_heights_;    ///< of the moving average
  ContradictingRun rejected_speeds_;      ///< ln of the ratio
  std::optional<double> speed_distance_;  ///< distance_ at the latest accepted speed
  /// ln of the height by planes that contradict a state of speeds.
  std::optional<double> contradicting_log_height_;
};

}  // namespace gsv
