#include "ground_scale_vo/scale/mounting.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"

namespace ground_scale_vo {
namespace {

/// Minimum absolute cosine of the angle between chord and optical axis. With sideways motion, or
/// with a chord too short to give the direction of travel, the pitch is not observable.
constexpr double kMinForward = 0.8;

}  // namespace

void Mounting::Options::validate() const { visitParameters(*this, RangeCheck("mounting/")); }

Mounting::Mounting(const Options& options) : options_(options) {
  options_.validate();
  reset();
}

void Mounting::reset() {
  pitch_ = {0, options_.initial_pitch_sigma};
  roll_ = {0, options_.initial_roll_sigma};
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

  const std::optional<MotionHistory::Chord> chord =
      history.chord(options_.chord_length_heights * height);
  if (chord) {
    // Kalman update of the pitch with Eq. 3 of Tian et al.: the road normal n is orthogonal to the
    // direction of motion t, here that of the chord. The measurement noise is the heave of the
    // vehicle between the ends of the chord; without a known height pitch_motion_sigma.
    const double chord_sigma = height > 0 ? options_.heave_sigma_heights * height / chord->length
                                          : options_.pitch_motion_sigma;
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

void Mounting::addSample(Average* average, double value, double sample_sigma,
                         double step_heights) const {
  // Samples within one chord length are correlated; together they count as one.
  const double information =
      step_heights / (options_.chord_length_heights * sample_sigma * sample_sigma);
  if (!(information > 0) || !areFinite(information, value)) return;
  // Capped: the mean forgets samples older than the forgetting distance.
  const double prior_information =
      std::min(1 / (average->sigma * average->sigma),
               options_.forgetting_distance_heights /
                   (options_.chord_length_heights * sample_sigma * sample_sigma));
  const double mean =
      average->mean + (value - average->mean) * information / (prior_information + information);
  average->mean = std::clamp(mean, -options_.max_tilt_rad, options_.max_tilt_rad);
  average->sigma = 1 / std::sqrt(prior_information + information);
}

void Mounting::update(const std::optional<MotionHistory::Chord>& chord, const GroundPlane* plane,
                      double step_heights) {
  if (plane != nullptr) {
    addSample(&roll_, -std::asin(std::clamp(plane->n_c.x(), -1.0, 1.0)), options_.roll_motion_sigma,
              step_heights);
  }
  if (chord && std::abs(chord->direction_c.z()) > kMinForward) {
    // The pitch at which normal() is orthogonal to the direction of motion.
    const Eigen::Vector3d t =
        chord->direction_c.z() > 0 ? chord->direction_c : Eigen::Vector3d(-chord->direction_c);
    const double ratio = -std::tan(roll_.mean) * t.x() / std::hypot(t.y(), t.z());
    addSample(&pitch_, std::asin(std::clamp(ratio, -1.0, 1.0)) - std::atan2(t.y(), t.z()),
              options_.pitch_motion_sigma, step_heights);
  }
}

}  // namespace ground_scale_vo
