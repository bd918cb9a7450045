#include "ground_scale_vo/scale/scale_filter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "ground_scale_vo/error.hpp"

namespace ground_scale_vo {
namespace {

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void ScaleFilter::Options::validate() const {
  requireInRange("filter correlation_h", correlation_h, 0, 1e6);
  requireInRange("filter drift_per_sqrt_h", drift_per_sqrt_h, 0, 1);
  requireInRange("filter measurement_floor", measurement_floor, 1e-4, 1);
  requireInRange("filter gate_sigma", gate_sigma, 0.1, 1000);
  requireInRange("filter start_measurements", start_measurements, 1, 1000);
  requireInRange("filter start_spread", start_spread, 1e-4, 10);
  requireInRange("filter restart_h", restart_h, 0, 1e6);
  requireInRange("filter moving_average_frames", moving_average_frames, 0, 1e6);
}

ScaleFilter::ScaleFilter(const Options& options) : options_(options) { options_.validate(); }

double ScaleFilter::height() const { return known_ ? std::exp(log_height_) : 0; }

double ScaleFilter::sigma() const { return known_ ? height() * std::sqrt(variance_) : 0; }

void ScaleFilter::move(double distance) {
  way_ += distance;
  if (known_) {
    variance_ += options_.drift_per_sqrt_h * options_.drift_per_sqrt_h * distance / height();
  }
}

bool ScaleFilter::update(double height, double sigma) {
  const double relative = std::hypot(sigma / height, options_.measurement_floor);
  const Measurement measurement{std::log(height), relative * relative, way_};
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
  if (!known_) return start(measurement);

  const double innovation = measurement.log_height - log_height_;
  if (std::abs(innovation) > options_.gate_sigma * std::sqrt(variance_ + measurement.variance)) {
    return start(measurement);
  }
  challengers_.clear();
  // A measurement whose predecessor lies closer than the correlation length brings only its share.
  const double share =
      std::min(1.0, (way_ - last_update_at_) / (options_.correlation_h * this->height()));
  last_update_at_ = way_;
  if (share > 0) {
    const double gain = variance_ / (variance_ + measurement.variance / share);
    log_height_ += gain * innovation;
    variance_ *= 1 - gain;
  }
  return true;
}

/// Collects measurements without, or against, the present state; takes them over when they agree.
/// True when they became the state.
bool ScaleFilter::start(const Measurement& measurement) {
  challengers_.push_back(measurement);
  const auto enough = static_cast<std::size_t>(options_.start_measurements);
  if (challengers_.size() < enough) return false;
  // At a start the latest few count; against a state, all for as long as restart_h.
  const double way = way_ - challengers_.front().at;
  if (known_ && way < options_.restart_h * height()) return false;

  std::vector<double> values;
  for (const Measurement& m : challengers_) values.push_back(m.log_height);
  const double middle = median(values);
  for (double& value : values) value = std::abs(value - middle);
  if (1.4826 * median(values) > options_.start_spread) {
    challengers_.erase(challengers_.begin());
    return false;
  }
  double variance = 0;
  for (const Measurement& m : challengers_) variance += m.variance;
  log_height_ = middle;
  variance_ = variance / static_cast<double>(challengers_.size());
  known_ = true;
  last_update_at_ = way_;
  challengers_.clear();
  return true;
}

void ScaleFilter::reset() { *this = ScaleFilter(options_); }

}  // namespace ground_scale_vo
