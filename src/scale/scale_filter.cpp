#include "scale/scale_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

/// Bounds of the factor on the variance: sigma changes by at most a factor of 4.5 either way, so
/// that neither a run of equal measurements nor of outliers makes it useless.
constexpr double kMinNisScale = 0.05, kMaxNisScale = 20;

/// Distances to the measured road over which the tilt of a young map decays to 1/e.
constexpr double kTiltDecay = 0.8;

/// [camera heights] Since the latest accepted direct measurement, while the road is the same.
constexpr double kRecentHeights = 5;

/// [camera heights] Over which the kerb decays to 1/e: it changes along a street.
constexpr double kKerbHeights = 30;

/// Standard deviation of the change of ln h when a refined lens replaces another.
constexpr double kLensChangeSigma = 0.02;

/// A camera height that is not given: between that of a small robot and of a lorry.
constexpr double kUnknownHeight = 1.3, kUnknownHeightSigma = 1;  // [m], of its ln
/// Standard deviation of ln h* from which on it is too large for a scale from the road alone.
constexpr double kMaxHeightSigma = 0.15;
/// Random walk of ln h* over a metre, by load and tyres: 1 % in a kilometre.
constexpr double kHeightDriftPerSqrtMetre = 0.0003;

// Speeds.
/// A run of rejected speeds that agree within this deviation of their ln restarts the filter, after
/// this distance [camera heights], or earlier in a young map: a slipping wheel ends before.
constexpr double kMaxSpeedDeviation = 0.05, kSpeedRestartDistance = 40;
constexpr std::size_t kMinPendingSpeeds = 4;
/// Of ln of the scale: a speed that deviates by more from the road is one in another unit.
constexpr double kOtherUnit = 0.5;

}  // namespace

ScaleFilter::ScaleFilter(const Options& options, const Prior& prior)
    : options_(options),
      prior_height_(prior.camera_height > 0 ? prior.camera_height : kUnknownHeight) {
  const double height_sigma = prior.camera_height > 0
                                  ? prior.camera_height_sigma / prior.camera_height
                                  : kUnknownHeightSigma;
  covariance_(kCameraHeight, kCameraHeight) = height_sigma * height_sigma;
  covariance_(kSpeedFactor, kSpeedFactor) = prior.speed_scale_sigma * prior.speed_scale_sigma;
  height_variance_limit_ = std::pow(std::min(height_sigma, kMaxHeightSigma), 2);
}

void ScaleFilter::startMap() {
  const ScaleFilter before = *this;
  *this = ScaleFilter(options_, {});
  prior_height_ = before.prior_height_;
  height_variance_limit_ = before.height_variance_limit_;
  state_.tail<2>() = before.state_.tail<2>();
  covariance_.bottomRightCorner<2, 2>() = before.covariance_.bottomRightCorner<2, 2>();
}

bool ScaleFilter::hasCameraHeight() const {
  return covariance_(kCameraHeight, kCameraHeight) <= kMaxHeightSigma * kMaxHeightSigma;
}

bool ScaleFilter::known() const { return started_ && (has_speed_ || hasCameraHeight()); }

bool ScaleFilter::heightKnown() const { return started_ && (has_plane_ || hasCameraHeight()); }

double ScaleFilter::height() const { return heightKnown() ? std::exp(state_[kHeight]) : 0; }

double ScaleFilter::scale() const {
  return known() ? cameraHeight() / std::exp(state_[kHeight]) : 0;
}

/// The NIS of planes tells nothing about the camera height and the factor of the speeds, so what
/// these contribute is not scaled by it.
double ScaleFilter::scaleSigma() const {
  if (!known()) return 0;
  StateVector J = StateVector::Zero();
  J[kHeight] = -1, J[kCameraHeight] = 1;
  const StateVector c = covariance_ * J;
  double constant = 0;
  for (const State i : {kCameraHeight, kSpeedFactor}) {
    if (covariance_(i, i) > 0) constant += c[i] * c[i] / covariance_(i, i);
  }
  const double variance = J.dot(c);
  constant = std::min(constant, variance);
  return scale() * std::sqrt(nis_scale_ * (variance - constant) + constant);
}

double ScaleFilter::cameraHeightSigma() const {
  return cameraHeight() * std::sqrt(covariance_(kCameraHeight, kCameraHeight));
}

void ScaleFilter::predict(double distance, double angle) {
  distance_ += distance;
  turned_ += angle;
  if (!started_) return;
  const double distance_heights = distance / std::exp(state_[kHeight]);
  const double drift_per_sqrt_rad =
      lens_is_estimated_ ? options_.drift_per_sqrt_rad_estimated_lens : options_.drift_per_sqrt_rad;
  covariance_(kHeight, kHeight) +=
      options_.drift_per_sqrt_height * options_.drift_per_sqrt_height * distance_heights +
      drift_per_sqrt_rad * drift_per_sqrt_rad * angle;
  const double kept = std::exp(-distance_heights / kKerbHeights);
  state_[kKerb] *= kept;
  covariance_.row(kKerb) *= kept;
  covariance_.col(kKerb) *= kept;
  covariance_(kKerb, kKerb) += (1 - kept * kept) * options_.kerb_sigma * options_.kerb_sigma;
  double& height_variance = covariance_(kCameraHeight, kCameraHeight);
  if (height_variance < height_variance_limit_) {
    const double drift = kHeightDriftPerSqrtMetre * kHeightDriftPerSqrtMetre * distance * scale();
    height_variance = std::min(height_variance + drift, height_variance_limit_);
  }
}

void ScaleFilter::changeLens() {
  if (started_) covariance_(kHeight, kHeight) += kLensChangeSigma * kLensChangeSigma;
}

bool ScaleFilter::update(double height, double sigma, double road_distance, Source source,
                         bool is_beside_lane) {
  if (!(height > 0 && sigma >= 0 && road_distance >= 0)) return false;
  if (!areFinite(height, sigma, road_distance)) return false;
  double relative_sigma = std::hypot(sigma / height, options_.min_measurement_sigma);
  if (lens_is_estimated_ && source == Source::kFeatureBased && isDirectAccepted()) {
    relative_sigma *= options_.feature_sigma_factor;
  }
  const Measurement measurement{std::log(height), relative_sigma * relative_sigma,
                                road_distance / height, is_beside_lane};
  if (options_.moving_average_frames > 0) return updateMovingAverage(height, measurement.variance);
  if (!started_) {
    if (distance_ < options_.start_distance_heights * height) return false;
    start(measurement);
    return true;
  }

  const StateVector H = jacobianOf(measurement);
  const double innovation = measurement.log_height - H.dot(state_);
  const double predicted_variance = H.dot(covariance_ * H);
  const double innovation_variance = predicted_variance + measurement.variance;
  SourceState& source_state = stateOf(source);
  const double gate = options_.gate_sigma * options_.gate_sigma;
  const double nis = innovation * innovation / innovation_variance;
  updateNisScale(std::min(nis, gate), &source_state);
  if (!has_plane_ && hasCameraHeight() && std::abs(innovation) > kOtherUnit) {
    start(measurement);  // from the road, after a start from speeds in another unit
    return true;
  }
  if (nis > gate) return restart(measurement, &source_state);
  clearPending(source);
  // Correlated with the previous measurement of this source when that is closer than the
  // correlation length: only this share of its information is new.
  const double share =
      std::min(1.0, (distance_ - source_state.accepted_at) /
                        (options_.correlation_heights * std::exp(state_[kHeight])));
  source_state.accepted_at = distance_;
  if (share > 0) correct(H, innovation, measurement.variance / share);
  has_plane_ = true;
  return true;
}

void ScaleFilter::correct(const StateVector& H, double innovation, double variance) {
  const StateVector gain = covariance_ * H / (H.dot(covariance_ * H) + variance);
  state_ += gain * innovation;
  covariance_ -= gain * (covariance_ * H).transpose();
}

/// Not long ago, in this map.
bool ScaleFilter::isDirectAccepted() {
  const double accepted_at = stateOf(Source::kDirect).accepted_at;
  return accepted_at > 0 && distance_ - accepted_at < kRecentHeights * std::exp(state_[kHeight]);
}

bool ScaleFilter::updateSpeed(double metres_per_unit, double relative_sigma) {
  const double log_scale = std::log(metres_per_unit), variance = relative_sigma * relative_sigma;
  if (!started_) {
    startFromSpeed(log_scale, variance);
    return true;
  }
  StateVector H = StateVector::Zero();
  H[kHeight] = -1, H[kCameraHeight] = H[kSpeedFactor] = 1;
  const double innovation = log_scale - std::log(prior_height_) - H.dot(state_);
  const double innovation_variance = H.dot(covariance_ * H) + variance;
  if (innovation * innovation > options_.gate_sigma * options_.gate_sigma * innovation_variance) {
    return restartFromSpeed(log_scale, variance);
  }
  pending_speeds_.clear();
  correct(H, innovation, variance);
  has_speed_ = true;
  speed_accepted_at_ = distance_;
  return true;
}

/// As restart(). The latest half of a minute of consistent speeds is believed more than planes.
bool ScaleFilter::restartFromSpeed(double log_scale, double variance) {
  const double deviation = std::abs(log_scale - state_[kSpeedFactor] - std::log(scale()));
  if (has_plane_ && hasCameraHeight() && deviation > kOtherUnit) return false;
  if (pending_speeds_.empty()) pending_speeds_since_ = distance_;
  pending_speeds_.push_back(log_scale);
  if (pending_speeds_.size() > kMinPendingSpeeds) pending_speeds_.pop_front();
  const double required_distance = std::min(pending_speeds_since_ - started_at_,
                                            kSpeedRestartDistance * std::exp(state_[kHeight]));
  if (pending_speeds_.size() < kMinPendingSpeeds ||
      distance_ - pending_speeds_since_ < required_distance) {
    return false;
  }
  const double middle = median({pending_speeds_.begin(), pending_speeds_.end()});
  for (const double each : pending_speeds_) {
    if (std::abs(each - middle) > kMaxSpeedDeviation) return false;
  }
  startFromSpeed(middle, variance);
  return true;
}

/// h follows from the speed as accurately as h* is known.
void ScaleFilter::startFromSpeed(double log_scale, double variance) {
  has_plane_ = false;
  const double factor_variance = covariance_(kSpeedFactor, kSpeedFactor);
  const double height_variance = covariance_(kCameraHeight, kCameraHeight);
  const double height_factor_covariance = covariance_(kCameraHeight, kSpeedFactor);
  start({std::log(cameraHeight()) + state_[kSpeedFactor] - log_scale,
         variance + height_variance + factor_variance + 2 * height_factor_covariance, 0});
  has_plane_ = false;
  has_speed_ = true;
  speed_accepted_at_ = distance_;
  covariance_(kHeight, kCameraHeight) = covariance_(kCameraHeight, kHeight) =
      height_variance + height_factor_covariance;
  covariance_(kHeight, kSpeedFactor) = covariance_(kSpeedFactor, kHeight) =
      factor_variance + height_factor_covariance;
}

/// The state becomes the mean of the latest scales 1/h.
bool ScaleFilter::updateMovingAverage(double height, double variance) {
  inverse_heights_.push_back(1 / height);
  if (inverse_heights_.size() > static_cast<std::size_t>(options_.moving_average_frames)) {
    inverse_heights_.pop_front();
  }
  state_[kHeight] =
      -std::log(std::accumulate(inverse_heights_.begin(), inverse_heights_.end(), 0.0) /
                static_cast<double>(inverse_heights_.size()));
  covariance_(kHeight, kHeight) = variance;
  started_ = has_plane_ = true;
  return true;
}

/// Of the measured ln h by the state.
ScaleFilter::StateVector ScaleFilter::jacobianOf(const Measurement& measurement) const {
  StateVector H = StateVector::Zero();
  H[kHeight] = 1;
  H[kTilt] = tiltLever(measurement);
  H[kKerb] = measurement.is_beside_lane ? 1 : 0;
  return H;
}

/// Change of the measured ln h by the tilt [1/rad]: the distance of the road, in camera heights,
/// and the decay of the tilt.
double ScaleFilter::tiltLever(const Measurement& measurement) const {
  const double decay_distance =
      kTiltDecay * measurement.road_distance * std::exp(measurement.log_height);
  if (!(decay_distance > 0)) return 0;  // the road below the camera
  return measurement.road_distance * std::exp((tilted_since_ - distance_) / decay_distance);
}

/// Moving average of the NIS over the distance.
void ScaleFilter::updateNisScale(double nis, SourceState* source) {
  const double rate = std::min(1.0, (distance_ - source->measured_at) /
                                        (options_.nis_memory_heights * std::exp(state_[kHeight])));
  source->measured_at = distance_;
  nis_scale_ = std::clamp(nis_scale_ + rate * (nis - nis_scale_), kMinNisScale, kMaxNisScale);
}

/// After an accepted measurement of a source: the pending ones do not lead to a restart. Direct
/// measurements start from the filter's own height and would confirm a wrong one, so they do not
/// clear feature-based ones that deviate strongly.
void ScaleFilter::clearPending(Source source) {
  stateOf(Source::kDirect).pending.clear();
  std::deque<Measurement>& feature_based = stateOf(Source::kFeatureBased).pending;
  const bool deviates =
      !feature_based.empty() &&
      std::abs(feature_based.back().log_height - state_[kHeight]) > options_.restart_max_deviation;
  if (source == Source::kFeatureBased || !deviates) feature_based.clear();
}

/// Adds a measurement that the state does not explain. When the latest few agree over a sufficient
/// distance, and no speed contradicts them, restarts the filter from their median; true when it
/// did. A rotation counts as the distance of equal process noise, with the noise for a lens that is
/// not estimated: in a turn the unit of the map may really change. A young state is replaced after
/// the distance over which measurements supported it. The tilt is then as in a new map, because the
/// cause of the contradiction is not known.
bool ScaleFilter::restart(const Measurement& measurement, SourceState* source) {
  std::deque<Measurement>& pending = source->pending;
  if (pending.empty()) {
    source->pending_since = distance_;
    source->turned_before = turned_;
  }
  pending.push_back(measurement);
  const auto required = static_cast<std::size_t>(options_.restart_measurements);
  if (pending.size() > required) pending.pop_front();
  const double measured_height = std::exp(measurement.log_height);
  const double heights_per_rad =
      options_.drift_per_sqrt_height > 0
          ? std::pow(options_.drift_per_sqrt_rad / options_.drift_per_sqrt_height, 2)
          : 0;
  const double persisted = distance_ - source->pending_since +
                           heights_per_rad * (turned_ - source->turned_before) * measured_height;
  const double required_distance = std::min(source->pending_since - started_at_,
                                            options_.restart_distance_heights * measured_height);
  if (pending.size() < required || persisted < required_distance) return false;
  const bool is_confirmed_by_speed =
      speed_accepted_at_ && *speed_accepted_at_ > source->pending_since &&
      (!hasCameraHeight() || std::abs(measurement.log_height - state_[kHeight]) < kOtherUnit);
  if (is_confirmed_by_speed) return false;
  std::vector<double> log_heights;
  double mean_variance = 0;
  for (const Measurement& m : pending) {
    log_heights.push_back(m.log_height);
    mean_variance += m.variance / static_cast<double>(required);
  }
  const double middle = median(log_heights);
  for (const double log_height : log_heights) {
    if (std::abs(log_height - middle) > options_.restart_max_deviation) return false;
  }
  tilted_since_ = distance_;
  start({middle, mean_variance, measurement.road_distance, measurement.is_beside_lane});
  return true;
}

void ScaleFilter::start(const Measurement& measurement) {
  const StateVector H = jacobianOf(measurement);
  state_.head<kCameraHeight>().setZero();
  covariance_.topRows<kCameraHeight>().setZero();
  covariance_.leftCols<kCameraHeight>().setZero();
  state_[kHeight] = measurement.log_height;
  covariance_(kHeight, kHeight) = measurement.variance;
  for (const auto& [i, sigma] :
       {std::pair(kTilt, options_.start_tilt_sigma_rad), std::pair(kKerb, options_.kerb_sigma)}) {
    const double variance = sigma * sigma;
    covariance_(i, i) = variance;
    covariance_(kHeight, i) = covariance_(i, kHeight) = -H[i] * variance;
    covariance_(kHeight, kHeight) += H[i] * H[i] * variance;
  }
  started_ = has_plane_ = true;
  has_speed_ = false;
  pending_speeds_.clear();
  started_at_ = distance_;
  nis_scale_ = 1;
  for (SourceState& source : sources_) source = {distance_, distance_, {}, 0, 0};
}

}  // namespace ground_scale_vo
