#include "ground_scale_vo/scale/mounting.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"

namespace ground_scale_vo {
namespace {

/// A chord that is this much sideways or steep says nothing of the pitch (cosine to the optical
/// axis).
constexpr double kMinForward = 0.8;

}  // namespace

void Mounting::Options::validate() const { visitParameters(*this, RangeCheck("mounting/")); }

Mounting::Mounting(const Options& options) : options_(options) {
  options_.validate();
  reset();
}

void Mounting::reset() {
  pitch_ = {0, options_.start_pitch_sigma};
  roll_ = {0, options_.start_roll_sigma};
}

Eigen::Vector3d Mounting::normal() const {
  return {-std::sin(roll_.mean), -std::cos(roll_.mean) * std::cos(pitch_.mean),
          -std::cos(roll_.mean) * std::sin(pitch_.mean)};
}

NormalPrior Mounting::prior(const MotionHistory& history, double height) const {
  NormalPrior prior;
  prior.n_c = normal();
  prior.pitch_sigma = std::hypot(pitch_.sigma, options_.pitch_motion_sigma);
  prior.roll_sigma = std::hypot(roll_.sigma, options_.roll_motion_sigma);

  const std::optional<MotionHistory::Chord> chord = history.chord(options_.chord_h * height);
  if (chord) {
    // Eq. 3, n orthogonal to the averaged t, as an observation of the pitch.
    const double chord_sigma =
        height > 0 ? options_.bounce_h * height / chord->length : options_.pitch_motion_sigma;
    const double prior_variance = prior.pitch_sigma * prior.pitch_sigma;
    const double gain = prior_variance / (prior_variance + chord_sigma * chord_sigma);
    const Eigen::Vector3d& t = chord->direction_c;
    prior.n_c = (prior.n_c - gain * prior.n_c.dot(t) * t).normalized();
    prior.pitch_sigma *= std::sqrt(1 - gain);
  }
  const Eigen::Vector3d ahead = chord ? chord->direction_c : Eigen::Vector3d::UnitZ();
  prior.forward_c = (ahead - prior.n_c.dot(ahead) * prior.n_c).normalized();
  return prior;
}

void Mounting::learn(Average* average, double value, double motion_sigma, double step_h) const {
  // The vehicle's own motion agrees with itself over a chord's length: one independent value each.
  const double information = step_h / (options_.chord_h * motion_sigma * motion_sigma);
  if (!(information > 0) || !areFinite(information, value)) return;
  const double kept =
      std::min(1 / (average->sigma * average->sigma),
               options_.memory_h / (options_.chord_h * motion_sigma * motion_sigma));
  const double mean = average->mean + (value - average->mean) * information / (kept + information);
  average->mean = std::clamp(mean, -options_.max_tilt_rad, options_.max_tilt_rad);
  average->sigma = 1 / std::sqrt(kept + information);
}

void Mounting::update(const std::optional<MotionHistory::Chord>& chord, const GroundPlane* plane,
                      double step_h) {
  if (plane != nullptr) {
    learn(&roll_, -std::asin(std::clamp(plane->n_c.x(), -1.0, 1.0)), options_.roll_motion_sigma,
          step_h);
  }
  if (chord && std::abs(chord->direction_c.z()) > kMinForward) {
    // The pitch at which normal() is orthogonal to the direction of motion.
    const Eigen::Vector3d t =
        chord->direction_c.z() > 0 ? chord->direction_c : Eigen::Vector3d(-chord->direction_c);
    const double ratio = -std::tan(roll_.mean) * t.x() / std::hypot(t.y(), t.z());
    learn(&pitch_, std::asin(std::clamp(ratio, -1.0, 1.0)) - std::atan2(t.y(), t.z()),
          options_.pitch_motion_sigma, step_h);
  }
}

}  // namespace ground_scale_vo
