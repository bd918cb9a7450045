#include "ground_scale_vo/scale/scale_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
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

/// Standard deviation of the change of ln h when a refined lens replaces another.
constexpr double kLensChangeSigma = 0.02;

}  // namespace

void ScaleFilter::Options::validate() const { visitParameters(*this, RangeCheck("filter/")); }

ScaleFilter::ScaleFilter(const Options& options) : options_(options) { options_.validate(); }

double ScaleFilter::height() const { return known_ ? std::exp(state_[0]) : 0; }

double ScaleFilter::sigma() const {
  return known_ ? height() * std::sqrt(nis_scale_ * covariance_(0, 0)) : 0;
}

void ScaleFilter::predict(double distance, double angle) {
  distance_ += distance;
  turned_ += angle;
  if (known_) {
    covariance_(0, 0) +=
        options_.drift_per_sqrt_height * options_.drift_per_sqrt_height * distance / height() +
        options_.drift_per_sqrt_rad * options_.drift_per_sqrt_rad * angle;
  }
}

void ScaleFilter::changeLens() {
  if (known_) covariance_(0, 0) += kLensChangeSigma * kLensChangeSigma;
}

bool ScaleFilter::update(double height, double sigma, double road_distance, Source source) {
  if (!(height > 0 && sigma >= 0 && road_distance >= 0)) return false;
  if (!areFinite(height, sigma, road_distance)) return false;
  const double relative_sigma = std::hypot(sigma / height, options_.min_measurement_sigma);
  const Measurement measurement{std::log(height), relative_sigma * relative_sigma,
                                road_distance / height};
  if (options_.moving_average_frames > 0) return updateMovingAverage(height, measurement.variance);
  if (!known_) {
    if (distance_ < options_.start_distance_heights * height) return false;
    start(measurement);
    return true;
  }

  const Eigen::Vector2d H(1, tiltLever(measurement));
  const double innovation = measurement.log_height - H.dot(state_);
  const double predicted_variance = H.dot(covariance_ * H);
  const double innovation_variance = predicted_variance + measurement.variance;
  SourceState& source_state = stateOf(source);
  const double gate = options_.gate_sigma * options_.gate_sigma;
  const double nis = innovation * innovation / innovation_variance;
  updateNisScale(std::min(nis, gate), &source_state);
  if (nis > gate) return restart(measurement, &source_state);
  clearPending(source);
  // Correlated with the previous measurement of this source when that is closer than the
  // correlation length: only this share of its information is new.
  const double share = std::min(1.0, (distance_ - source_state.accepted_at) /
                                         (options_.correlation_heights * this->height()));
  source_state.accepted_at = distance_;
  if (share > 0) {
    const Eigen::Vector2d gain =
        covariance_ * H / (predicted_variance + measurement.variance / share);
    state_ += gain * innovation;
    covariance_ -= gain * (covariance_ * H).transpose();
  }
  return true;
}

/// The state becomes the mean of the latest scales 1/h.
bool ScaleFilter::updateMovingAverage(double height, double variance) {
  inverse_heights_.push_back(1 / height);
  if (inverse_heights_.size() > static_cast<std::size_t>(options_.moving_average_frames)) {
    inverse_heights_.pop_front();
  }
  state_[0] = -std::log(std::accumulate(inverse_heights_.begin(), inverse_heights_.end(), 0.0) /
                        static_cast<double>(inverse_heights_.size()));
  covariance_(0, 0) = variance;
  known_ = true;
  return true;
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
  const double rate = std::min(
      1.0, (distance_ - source->measured_at) / (options_.nis_memory_heights * this->height()));
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
      std::abs(feature_based.back().log_height - state_[0]) > options_.restart_max_deviation;
  if (source == Source::kFeatureBased || !deviates) feature_based.clear();
}

/// Adds a measurement that the state does not explain. When the latest few agree over a sufficient
/// distance, restarts the filter from their median; true when it did. A rotation counts as the
/// distance of equal process noise: in a turn the unit of the map may really change. A young state
/// is replaced after the distance over which measurements supported it. The tilt is then as in a
/// new map, because the cause of the contradiction is not known.
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
  start({middle, mean_variance, measurement.road_distance});
  return true;
}

void ScaleFilter::start(const Measurement& measurement) {
  const double tilt_lever = tiltLever(measurement);
  const double tilt_variance = options_.start_tilt_sigma_rad * options_.start_tilt_sigma_rad;
  state_ << measurement.log_height, 0;
  covariance_ << measurement.variance + tilt_lever * tilt_lever * tilt_variance,
      -tilt_lever * tilt_variance, -tilt_lever * tilt_variance, tilt_variance;
  known_ = true;
  started_at_ = distance_;
  nis_scale_ = 1;
  for (SourceState& source : sources_) source = {distance_, distance_, {}, 0, 0};
}

}  // namespace ground_scale_vo
