#include "ground_scale_vo/scale/scale_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/median.hpp"

namespace ground_scale_vo {
namespace {

/// Limits of the factor on the variance.
constexpr double kMinAgreement = 0.05, kMaxAgreement = 20;

}  // namespace

void ScaleFilter::Options::validate() const { visitParameters(*this, RangeCheck("filter/")); }

ScaleFilter::ScaleFilter(const Options& options) : options_(options) { options_.validate(); }

double ScaleFilter::height() const { return known_ ? std::exp(log_height_) : 0; }

double ScaleFilter::sigma() const {
  return known_ ? height() * std::sqrt(agreement_ * variance_) : 0;
}

void ScaleFilter::move(double distance, double angle) {
  way_ += distance;
  if (known_) {
    variance_ += options_.drift_per_sqrt_h * options_.drift_per_sqrt_h * distance / height() +
                 options_.drift_per_sqrt_rad * options_.drift_per_sqrt_rad * angle;
  }
}

bool ScaleFilter::update(double height, double sigma, Source source) {
  if (!(height > 0 && sigma >= 0) || !areFinite(height, sigma)) return false;
  const double relative = std::hypot(sigma / height, options_.measurement_floor);
  const Measurement measurement{std::log(height), relative * relative};
  if (options_.moving_average_frames > 0) {
    inverse_heights_.push_back(1 / height);
    if (inverse_heights_.size() > static_cast<std::size_t>(options_.moving_average_frames)) {
      inverse_heights_.pop_front();
    }
    log_height_ = -std::log(std::accumulate(inverse_heights_.begin(), inverse_heights_.end(), 0.0) /
                            static_cast<double>(inverse_heights_.size()));
    variance_ = measurement.variance;
    known_ = true;
    return true;
  }
  if (!known_) return start(measurement, Source::kPoints);

  const double innovation = measurement.log_height - log_height_;
  const double expected = variance_ + measurement.variance;
  const double gate = options_.gate_sigma * options_.gate_sigma;
  const double squared = innovation * innovation / expected;
  learnAgreement(source, std::min(squared, gate));
  if (squared > gate) return start(measurement, source);
  settle(source);
  // A measurement whose predecessor lies closer than the correlation length brings only its share.
  double& last = last_update_at_[static_cast<std::size_t>(source)];
  const double share = std::min(1.0, (way_ - last) / (options_.correlation_h * this->height()));
  last = way_;
  if (share > 0) {
    const double gain = variance_ / (variance_ + measurement.variance / share);
    log_height_ += gain * innovation;
    variance_ = std::max((1 - gain) * variance_, sharedVariance());
  }
  return true;
}

/// What all measurements of a young map have in common cannot be seen in them.
double ScaleFilter::sharedVariance() const {
  const double shared =
      options_.start_sigma * std::exp(-way_ / (options_.start_memory_h * height()));
  return shared * shared;
}

/// squared: an innovation's square over its expected one.
void ScaleFilter::learnAgreement(Source source, double squared) {
  double& last = last_seen_at_[static_cast<std::size_t>(source)];
  const double rate = std::min(1.0, (way_ - last) / (options_.agreement_memory_h * this->height()));
  last = way_;
  agreement_ = std::clamp(agreement_ + rate * (squared - agreement_), kMinAgreement, kMaxAgreement);
}

/// A measurement of that source agrees with the state: what spoke against the state is forgotten.
/// But pixels are sought around the state and would agree with a wrong one too, so they do not
/// silence points that lie far off.
void ScaleFilter::settle(Source source) {
  challengers_[static_cast<std::size_t>(Source::kPixels)].clear();
  std::deque<Measurement>& points = challengers_[static_cast<std::size_t>(Source::kPoints)];
  const bool far_off =
      !points.empty() && std::abs(points.back().log_height - log_height_) > options_.start_spread;
  if (source == Source::kPoints || !far_off) points.clear();
}

/// Collects measurements without, or against, the present state; the latest few become the state
/// when they agree and enough way has been made. True when they did.
bool ScaleFilter::start(const Measurement& measurement, Source source) {
  std::deque<Measurement>& challengers = challengers_[static_cast<std::size_t>(source)];
  double& challenged_at = challenged_at_[static_cast<std::size_t>(source)];
  if (challengers.empty()) challenged_at = way_;
  challengers.push_back(measurement);
  const auto enough = static_cast<std::size_t>(options_.start_measurements);
  if (challengers.size() > enough) challengers.pop_front();
  const double way = way_ - (known_ ? challenged_at : 0);
  const double needed_h = known_ ? options_.restart_h : options_.start_way_h;
  if (challengers.size() < enough || way < needed_h * std::exp(measurement.log_height)) {
    return false;
  }
  std::vector<double> values;
  double variance = 0;
  for (const Measurement& m : challengers) {
    values.push_back(m.log_height);
    variance += m.variance / static_cast<double>(enough);
  }
  const double middle = median(values);
  for (const double value : values) {
    if (std::abs(value - middle) > options_.start_spread) return false;
  }
  log_height_ = middle;
  // A restart says that something was wrong, whatever the map's age.
  const bool restarts = known_;
  known_ = true;
  variance_ =
      variance + (restarts ? options_.start_sigma * options_.start_sigma : sharedVariance());
  last_update_at_.fill(way_);
  last_seen_at_.fill(way_);
  agreement_ = 1;
  for (std::deque<Measurement>& each : challengers_) each.clear();
  return true;
}

void ScaleFilter::reset() { *this = ScaleFilter(options_); }

}  // namespace ground_scale_vo
