#include "scale/scale_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// [standard deviations] Measurements with a larger normalised innovation are rejected.
constexpr double kGate = 3;
/// Lower bound of a measurement's relative standard deviation: camber and the road's roughness.
constexpr double kMinMeasurementSigma = 0.015;
/// On the standard deviation of feature-based measurements while direct ones are accepted, with a
/// lens that is known well enough for the direct ones to be the better ones.
constexpr double kFeatureSigmaFactor = 2;
constexpr double kKnownK1Sigma = 0.01;
/// [camera heights] Since the latest accepted direct measurement, while the road is the same.
constexpr double kRecentHeights = 5;
/// [camera heights] Least distance before the first measurement: the first views have a baseline
/// that is too short.
constexpr double kStartDistance = 0.5;
/// Least factor on the variance: a run of equal measurements divides sigma by at most 4.5. The gate
/// bounds the innovations, and with them the factor, above.
constexpr double kMinNisScale = 0.05;
/// Distances to the measured road over which the tilt of a young map decays to 1/e.
constexpr double kTiltDecay = 0.8;

// A run of rejected measurements restarts the filter when they agree within this deviation of their
// ln, after this distance [camera heights], or earlier in a young map: parked cars and a slipping
// wheel end before.
constexpr double kMaxDeviation = 0.15, kRestartDistance = 12;
/// [camera heights/rad] A rotation counts as this distance: in a turn the unit of the map may
/// really change.
constexpr double kHeightsPerRad = 25;
constexpr double kMaxSpeedDeviation = 0.05, kSpeedRestartDistance = 40;
/// Of ln of the scale: a speed that deviates by more from the road is one in another unit.
constexpr double kOtherUnit = 0.5;

}  // namespace

void ScaleFilter::startMap() {
  HeightState state = state_;
  state.startMap();
  *this = ScaleFilter(options_, {});
  state_ = predicted_ = state;
}

bool ScaleFilter::known() const { return started_ && (has_speed_ || hasCameraHeight()); }

bool ScaleFilter::heightKnown() const { return started_ && (has_plane_ || hasCameraHeight()); }

double ScaleFilter::height() const { return heightKnown() ? state_.height() : 0; }

double ScaleFilter::scale() const { return known() ? cameraHeight() / state_.height() : 0; }

double ScaleFilter::scaleSigma() const {
  return known() ? scale() * state_.scaleSigma(nis_scale_) : 0;
}

double ScaleFilter::heightBySpeeds() const {
  return contradicting_log_height_ ? scale() * std::exp(*contradicting_log_height_)
                                   : cameraHeight();
}

void ScaleFilter::predict(double distance, double angle, double k1_sigma) {
  distance_ += distance;
  turned_ += angle;
  k1_sigma_ = k1_sigma;
  if (started_) state_.predict(distance, scale(), angle, k1_sigma);
  predicted_ = state_;
  wrong_since_.reset();
}

void ScaleFilter::changeLens() {
  if (started_) state_.changeLens();
}

bool ScaleFilter::update(double height, double sigma, double road_distance, Source source,
                         bool is_beside_lane) {
  if (!(height > 0 && sigma >= 0 && road_distance >= 0)) return false;
  if (!areFinite(height, sigma, road_distance)) return false;
  double relative_sigma = std::hypot(sigma / height, kMinMeasurementSigma);
  if (k1_sigma_ < kKnownK1Sigma && source == Source::kFeatureBased && isDirectAccepted()) {
    relative_sigma *= kFeatureSigmaFactor;
  }
  const Measurement measurement{std::log(height), relative_sigma * relative_sigma,
                                road_distance / height, is_beside_lane};
  if (options_.moving_average_frames > 0) return updateMovingAverage(height, measurement.variance);
  if (!started_) {
    if (distance_ < kStartDistance * height) return false;
    start(measurement);
    return true;
  }

  const HeightState::Vector H = jacobianOf(measurement);
  const double innovation = measurement.log_height - state_.predicted(H);
  const double nis = innovation * innovation / (state_.variance(H) + measurement.variance);
  SourceState& source_state = stateOf(source);
  updateNisScale(std::min(nis, kGate * kGate), &source_state);
  if (!has_plane_ && hasCameraHeight() && std::abs(innovation) > kOtherUnit) {
    wrong_since_ = 0;
    start(measurement);  // from the road, after a start from speeds in another unit
    return true;
  }
  if (nis > kGate * kGate) return restart(measurement, &source_state);
  clearRejected(source);
  // Correlated with the previous measurement of this source when that is closer than the
  // correlation length: only this share of its information is new.
  const double share = std::min(1.0, (distance_ - source_state.accepted_distance) /
                                         (options_.correlation_heights * state_.height()));
  source_state.accepted_distance = distance_;
  if (share > 0) state_.correct(H, innovation, measurement.variance / share);
  has_plane_ = true;
  return true;
}

/// Not long ago, in this map.
bool ScaleFilter::isDirectAccepted() {
  const double accepted = stateOf(Source::kDirect).accepted_distance;
  return accepted > 0 && distance_ - accepted < kRecentHeights * state_.height();
}

bool ScaleFilter::updateSpeed(double metres_per_unit, double relative_sigma) {
  const double log_scale = std::log(metres_per_unit), variance = relative_sigma * relative_sigma;
  if (!started_) {
    startFromSpeed(log_scale, variance);
    return true;
  }
  const HeightState::Vector H = HeightState::speedJacobian();
  const double innovation = state_.speedInnovation(log_scale);
  const double innovation_variance = state_.variance(H) + variance;
  if (innovation * innovation > kGate * kGate * innovation_variance) {
    return restartFromSpeed(log_scale, variance);
  }
  rejected_speeds_.clear();
  state_.correct(H, innovation, variance);
  has_speed_ = true;
  speed_distance_ = distance_;
  return true;
}

/// The state becomes the mean of the latest scales 1/h.
bool ScaleFilter::updateMovingAverage(double height, double variance) {
  inverse_heights_.push_back(1 / height);
  if (inverse_heights_.size() > static_cast<std::size_t>(options_.moving_average_frames)) {
    inverse_heights_.pop_front();
  }
  state_.set(-std::log(std::accumulate(inverse_heights_.begin(), inverse_heights_.end(), 0.0) /
                       static_cast<double>(inverse_heights_.size())),
             variance);
  started_ = has_plane_ = true;
  return true;
}

/// Derivatives of the measured ln h by the state. By the tilt: the distance of the road, in camera
/// heights, and the decay of the tilt [1/rad].
HeightState::Vector ScaleFilter::jacobianOf(const Measurement& measurement) const {
  HeightState::Vector H = HeightState::Vector::Unit(HeightState::kHeight);
  const double decay_distance =
      kTiltDecay * measurement.road_distance * std::exp(measurement.log_height);
  if (decay_distance > 0) {  // else it is the road below the camera
    H[HeightState::kTilt] =
        measurement.road_distance * std::exp((tilt_distance_ - distance_) / decay_distance);
  }
  H[HeightState::kKerb] = measurement.is_beside_lane ? 1 : 0;
  return H;
}

/// Moving average of the NIS over the distance.
void ScaleFilter::updateNisScale(double nis, SourceState* source) {
  const double rate = std::min(1.0, (distance_ - source->measured_distance) /
                                        (options_.nis_memory_heights * state_.height()));
  source->measured_distance = distance_;
  nis_scale_ = std::max(kMinNisScale, nis_scale_ + rate * (nis - nis_scale_));
}

/// After an accepted measurement of a source: the rejected ones do not lead to a restart. Direct
/// measurements start from the filter's own height and would confirm a wrong one, so they do not
/// clear feature-based ones that deviate strongly.
void ScaleFilter::clearRejected(Source source) {
  contradicting_log_height_.reset();
  stateOf(Source::kDirect).rejected.clear();
  ContradictingRun& feature_based = stateOf(Source::kFeatureBased).rejected;
  const bool deviates =
      !feature_based.empty() &&
      std::abs(feature_based.latest() - state_[HeightState::kHeight]) > kMaxDeviation;
  if (source == Source::kFeatureBased || !deviates) feature_based.clear();
}

/// Adds a measurement that the state does not explain. When the latest few agree over a sufficient
/// distance, and no speed contradicts them, restarts the filter from them; true when it did. A
/// rotation counts as the distance of equal process noise, with the noise for a lens that is not
/// estimated: in a turn the unit of the map may really change. A young state is replaced after the
/// distance over which measurements supported it. The tilt is then as in a new map, because the
/// cause of the contradiction is not known.
bool ScaleFilter::restart(const Measurement& measurement, SourceState* source) {
  ContradictingRun& run = source->rejected;
  run.add({measurement.log_height, measurement.variance}, distance_, turned_);
  const double measured_height = std::exp(measurement.log_height);
  const double persisted =
      distance_ - run.since() + kHeightsPerRad * (turned_ - run.turnedBefore()) * measured_height;
  if (persisted < std::min(run.since() - start_distance_, kRestartDistance * measured_height)) {
    return false;
  }
  const bool is_confirmed_by_speed =
      speed_distance_ && *speed_distance_ > run.since() &&
      (!hasCameraHeight() ||
       std::abs(measurement.log_height - state_[HeightState::kHeight]) < kOtherUnit);
  const auto agreement = run.agreement(kMaxDeviation);
  if (!agreement) return false;
  if (is_confirmed_by_speed) {
    contradicting_log_height_ = agreement->value;
    return false;
  }
  tilt_distance_ = distance_;
  wrong_since_ = run.since();
  start({agreement->value, agreement->variance, measurement.road_distance,
         measurement.is_beside_lane});
  return true;
}

/// As restart(): the latest half of a minute of consistent speeds counts more than planes.
bool ScaleFilter::restartFromSpeed(double log_scale, double variance) {
  const double deviation =
      std::abs(log_scale - state_[HeightState::kSpeedFactor] - std::log(scale()));
  if (has_plane_ && hasCameraHeight() && deviation > kOtherUnit) return false;
  ContradictingRun& run = rejected_speeds_;
  run.add({log_scale, variance}, distance_, turned_);
  if (distance_ - run.since() <
      std::min(run.since() - start_distance_, kSpeedRestartDistance * state_.height())) {
    return false;
  }
  const auto agreement = run.agreement(kMaxSpeedDeviation);
  if (!agreement) return false;
  wrong_since_ = run.since();
  startFromSpeed(agreement->value, agreement->variance);
  return true;
}

void ScaleFilter::start(const Measurement& measurement) {
  state_.start(measurement.log_height, measurement.variance, jacobianOf(measurement),
               turned_ - start_turned_);
  start_turned_ = turned_;
  has_plane_ = true;
  has_speed_ = false;
  started();
}

void ScaleFilter::startFromSpeed(double log_scale, double variance) {
  state_.startFromSpeed(log_scale, variance);
  has_plane_ = false;
  has_speed_ = true;
  speed_distance_ = distance_;
  started();
}

void ScaleFilter::started() {
  started_ = true;
  rejected_speeds_.clear();
  contradicting_log_height_.reset();
  start_distance_ = distance_;
  nis_scale_ = 1;
  for (SourceState& source : sources_) source = {distance_, distance_, {}};
}

}  // namespace gsv
