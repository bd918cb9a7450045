#include "scale/mounting.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

/// Largest absolute sine of the angle between a chord and the road. A steeper one is too short to
/// give the direction of travel.
constexpr double kMaxSlope = 0.8;

/// [rad] Standard deviation of the initial roll, which is zero: cameras are mounted level by eye.
constexpr double kInitialRollSigma = 0.1;
/// [camera heights] Averaging length of pitch and roll: the load changes slowly.
constexpr double kForgettingDistance = 200;
/// [rad] Standard deviation of the vehicle's roll against the road (curves, camber).
constexpr double kRollMotionSigma = 0.012;

bool givesDirection(const RoadPrior& prior, const Eigen::Vector3d& n_c) {
  return prior.chord && std::abs(n_c.dot(prior.chord->direction_c)) < kMaxSlope;
}

}  // namespace

Mounting::Mounting(const Options& options) : options_(options) {
  mean_.covariance.diagonal() << std::pow(kInitialRollSigma, 2), 0,
      std::pow(options_.initial_pitch_sigma, 2);
}

double Mounting::sigma() const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(mean_.covariance,
                                                              Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues().maxCoeff()));
}

/// Keeps the covariance in the tangent plane of the new normal.
void Mounting::Normal::set(const Eigen::Vector3d& n) {
  n_c = n.normalized();
  const Eigen::Matrix3d tangent = Eigen::Matrix3d::Identity() - n_c * n_c.transpose();
  covariance = tangent * covariance * tangent;
}

void Mounting::Normal::update(const Eigen::Vector3d& axis, double tangent,
                              double measurement_variance) {
  const Eigen::Vector3d gain = covariance * axis / (variance(axis) + measurement_variance);
  covariance -= gain * (axis.transpose() * covariance).eval();
  set(n_c + gain * tangent);
}

RoadPrior Mounting::prior(const CameraPath& path, double height) const {
  RoadPrior prior;
  prior.chord = path.chord(options_.chord_length_heights * height);
  const bool has_direction = givesDirection(prior, mean_.n_c);
  const Eigen::Vector3d ahead = has_direction ? prior.chord->direction_c : Eigen::Vector3d::UnitZ();

  Normal normal = mean_;
  Eigen::Matrix3d R_c_road = roadAxes(normal.n_c, ahead);  // columns: ahead, left, up
  normal.covariance +=
      std::pow(options_.pitch_motion_sigma, 2) * R_c_road.col(0) * R_c_road.col(0).transpose();
  normal.covariance +=
      kRollMotionSigma * kRollMotionSigma * R_c_road.col(1) * R_c_road.col(1).transpose();
  if (has_direction) {
    // Eq. 3 of Tian et al.: the road normal n is orthogonal to the direction of motion t, here that
    // of the chord. The measurement noise is the heave of the vehicle between the ends of the
    // chord; without a known height pitch_motion_sigma.
    const double chord_sigma = height > 0
                                   ? options_.heave_sigma_heights * height / prior.chord->length
                                   : options_.pitch_motion_sigma;
    normal.update(R_c_road.col(0), -normal.n_c.dot(ahead) / R_c_road.col(0).dot(ahead),
                  chord_sigma * chord_sigma);
    R_c_road = roadAxes(normal.n_c, ahead);
  }
  prior.n_c = normal.n_c;
  prior.forward_c = R_c_road.col(0);
  prior.pitch_sigma = std::sqrt(normal.variance(prior.forward_c));
  prior.roll_sigma = std::sqrt(normal.variance(prior.lateral()));
  return prior;
}

void Mounting::addSample(const Eigen::Vector3d& axis, double tangent, double sample_sigma,
                         double step_heights) {
  // Samples within one chord length are correlated; together they count as one.
  const double variance_heights =
      options_.chord_length_heights * sample_sigma * sample_sigma;  // for one camera height
  if (!(step_heights > 0) || !areFinite(step_heights, tangent)) return;
  // Lower bound of the variance: the mean forgets samples older than the forgetting distance.
  const double shortfall = variance_heights / kForgettingDistance - mean_.variance(axis);
  if (shortfall > 0) mean_.covariance += shortfall * axis * axis.transpose();
  mean_.update(axis, tangent, variance_heights / step_heights);
  limitTilt();
}

void Mounting::limitTilt() {
  const double limit = options_.max_tilt_rad;
  if (std::abs(pitch()) <= limit && std::abs(roll()) <= limit) return;
  mean_.set(roadNormal(std::clamp(pitch(), -limit, limit), std::clamp(roll(), -limit, limit)));
}

void Mounting::update(const RoadPrior& prior, const GroundPlane* plane, double step,
                      double height) {
  const bool has_direction = givesDirection(prior, mean_.n_c);
  const Eigen::Vector3d ahead = has_direction ? prior.chord->direction_c : Eigen::Vector3d::UnitZ();
  if (plane != nullptr) {
    const Eigen::Vector3d left = roadAxes(mean_.n_c, ahead).col(1);
    addSample(left, plane->n_c.dot(left) / plane->n_c.dot(mean_.n_c), kRollMotionSigma,
              step / height);
  }
  if (has_direction) {
    const Eigen::Vector3d along = roadAxes(mean_.n_c, ahead).col(0);
    const double chord_sigma = options_.heave_sigma_heights * height / prior.chord->length;
    addSample(along, -mean_.n_c.dot(ahead) / along.dot(ahead),
              std::hypot(options_.pitch_motion_sigma, chord_sigma), step / height);
  }
}

}  // namespace ground_scale_vo
