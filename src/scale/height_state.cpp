#include "scale/height_state.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <vector>

#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// A camera height that is not given: between that of a small robot and of a lorry.
constexpr double kUnknownHeight = 1.3, kUnknownHeightSigma = 1;  // [m], of its ln
/// Standard deviation of ln h* from which on it is too large for a scale from the road alone.
constexpr double kMaxCameraHeightSigma = 0.15;
/// Random walk of ln h* over a metre, by load and tyres: 1 % in a kilometre.
constexpr double kHeightDriftPerSqrtMetre = 0.0003;
/// [camera heights] Over which the kerb decays to 1/e: it changes along a street.
constexpr double kKerbHeights = 30;
/// Standard deviation of the change of ln h when a refined lens replaces another.
constexpr double kLensChangeSigma = 0.02;
/// Random walk of ln h with an exact lens over one camera height of distance, and over one radian:
/// a turn replaces the part of the map that carries the scale.
constexpr double kDriftPerSqrtHeight = 0.0045, kDriftPerSqrtRad = 0.02;
/// The same over a camera height, in addition, per standard deviation of k1.
constexpr double kDriftPerSqrtHeightPerK1 = 0.45;

constexpr std::size_t kRunLength = 4;  ///< measurements that must agree to restart the filter

}  // namespace

HeightState::HeightState(const ScaleFilterOptions& options, const Prior& prior)
    : options_(options),
      prior_height_(prior.camera_height > 0 ? prior.camera_height : kUnknownHeight) {
  const double height_sigma = prior.camera_height > 0
                                  ? prior.camera_height_sigma / prior.camera_height
                                  : kUnknownHeightSigma;
  covariance_(kCameraHeight, kCameraHeight) = height_sigma * height_sigma;
  covariance_(kSpeedFactor, kSpeedFactor) = prior.speed_scale_sigma * prior.speed_scale_sigma;
  height_variance_limit_ = std::pow(std::min(height_sigma, kMaxCameraHeightSigma), 2);
}

void HeightState::startMap() {
  state_.head<kCameraHeight>().setZero();
  covariance_.topRows<kCameraHeight>().setZero();
  covariance_.leftCols<kCameraHeight>().setZero();
}

void HeightState::start(double log_height, double variance, const Vector& H, double turned) {
  startMap();
  set(log_height, variance);
  const double tilt_sigma =
      std::hypot(options_.start_tilt_sigma_rad, options_.start_tilt_per_rad * turned);
  for (const auto& [i, sigma] :
       {std::pair(kTilt, tilt_sigma), std::pair(kKerb, options_.kerb_sigma)}) {
    const double of_state = sigma * sigma;
    covariance_(i, i) = of_state;
    covariance_(kHeight, i) = covariance_(i, kHeight) = -H[i] * of_state;
    covariance_(kHeight, kHeight) += H[i] * H[i] * of_state;
  }
}

void HeightState::startFromSpeed(double log_scale, double variance) {
  const double factor_variance = covariance_(kSpeedFactor, kSpeedFactor);
  const double height_variance = covariance_(kCameraHeight, kCameraHeight);
  const double height_factor_covariance = covariance_(kCameraHeight, kSpeedFactor);
  start(std::log(cameraHeight()) + state_[kSpeedFactor] - log_scale,
        variance + height_variance + factor_variance + 2 * height_factor_covariance,
        Vector::Unit(kHeight));
  covariance_(kHeight, kCameraHeight) = covariance_(kCameraHeight, kHeight) =
      height_variance + height_factor_covariance;
  covariance_(kHeight, kSpeedFactor) = covariance_(kSpeedFactor, kHeight) =
      factor_variance + height_factor_covariance;
}

void HeightState::set(double log_height, double variance) {
  state_[kHeight] = log_height;
  covariance_(kHeight, kHeight) = variance;
}

void HeightState::predict(double distance, double metres_per_unit, double angle, double k1_sigma) {
  const double distance_heights = distance / height();
  const double drift_per_sqrt_height =
      std::hypot(kDriftPerSqrtHeight, kDriftPerSqrtHeightPerK1 * k1_sigma);
  const double drift_per_sqrt_rad =
      std::hypot(kDriftPerSqrtRad, options_.drift_per_k1_sigma * k1_sigma);
  covariance_(kHeight, kHeight) +=
      drift_per_sqrt_height * drift_per_sqrt_height * distance_heights +
      drift_per_sqrt_rad * drift_per_sqrt_rad * angle;
  kerb_kept_ = std::exp(-distance_heights / kKerbHeights);
  state_[kKerb] *= kerb_kept_;
  covariance_.row(kKerb) *= kerb_kept_;
  covariance_.col(kKerb) *= kerb_kept_;
  covariance_(kKerb, kKerb) +=
      (1 - kerb_kept_ * kerb_kept_) * options_.kerb_sigma * options_.kerb_sigma;
  double& height_variance = covariance_(kCameraHeight, kCameraHeight);
  if (height_variance < height_variance_limit_) {
    const double drift =
        kHeightDriftPerSqrtMetre * kHeightDriftPerSqrtMetre * distance * metres_per_unit;
    height_variance = std::min(height_variance + drift, height_variance_limit_);
  }
}

void HeightState::changeLens() {
  covariance_(kHeight, kHeight) += kLensChangeSigma * kLensChangeSigma;
}

void HeightState::correct(const Vector& H, double innovation, double variance) {
  const Vector gain = covariance_ * H / (H.dot(covariance_ * H) + variance);
  state_ += gain * innovation;
  covariance_ -= gain * (covariance_ * H).transpose();
}

HeightState HeightState::smoothed(const HeightState& predicted, const HeightState& next) const {
  Vector transition = Vector::Ones(), inverse_sigma = Vector::Zero();
  transition[kKerb] = predicted.kerb_kept_;
  // A state that is known exactly, or from here on not the same any more, has no variance.
  for (int i = 0; i < kStates; ++i) {
    const double variance = predicted.covariance_(i, i);
    if (variance > 0) inverse_sigma[i] = 1 / std::sqrt(variance);
  }
  const Matrix correlation =
      inverse_sigma.asDiagonal() * predicted.covariance_ * inverse_sigma.asDiagonal();
  const Matrix gain = covariance_ * transition.asDiagonal() * inverse_sigma.asDiagonal() *
                      correlation.completeOrthogonalDecomposition().pseudoInverse() *
                      inverse_sigma.asDiagonal();
  HeightState result = *this;
  result.state_ += gain * (next.state_ - predicted.state_);
  result.covariance_ += gain * (next.covariance_ - predicted.covariance_) * gain.transpose();
  return result;
}

double HeightState::cameraHeightSigma() const {
  return cameraHeight() * std::sqrt(covariance_(kCameraHeight, kCameraHeight));
}

bool HeightState::hasCameraHeight() const {
  return covariance_(kCameraHeight, kCameraHeight) <= kMaxCameraHeightSigma * kMaxCameraHeightSigma;
}

HeightState::Vector HeightState::speedJacobian() {
  Vector H = Vector::Zero();
  H[kHeight] = -1, H[kCameraHeight] = H[kSpeedFactor] = 1;
  return H;
}

double HeightState::speedInnovation(double log_scale) const {
  return log_scale - std::log(prior_height_) - predicted(speedJacobian());
}

double HeightState::scaleSigma(double nis_scale) const {
  Vector J = Vector::Zero();
  J[kHeight] = -1, J[kCameraHeight] = 1;
  const Vector c = covariance_ * J;
  double constant = 0;
  for (const Index i : {kCameraHeight, kSpeedFactor}) {
    if (covariance_(i, i) > 0) constant += c[i] * c[i] / covariance_(i, i);
  }
  const double variance = J.dot(c);
  constant = std::min(constant, variance);
  return std::sqrt(nis_scale * (variance - constant) + constant);
}

void ContradictingRun::add(const Sample& sample, double distance, double turned) {
  if (samples_.empty()) {
    since_ = distance;
    turned_ = turned;
  }
  samples_.push_back(sample);
  if (samples_.size() > kRunLength) samples_.pop_front();
}

std::optional<ContradictingRun::Sample> ContradictingRun::agreement(double max_deviation) const {
  if (samples_.size() < kRunLength) return std::nullopt;
  std::vector<double> values;
  Sample result;
  for (const Sample& sample : samples_) {
    values.push_back(sample.value);
    result.variance += sample.variance / static_cast<double>(kRunLength);
  }
  result.value = median(values);
  for (const double value : values) {
    if (std::abs(value - result.value) > max_deviation) return std::nullopt;
  }
  return result;
}

}  // namespace gsv
