#include "scale/road.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "scale/camera_path.hpp"

namespace gsv {
namespace {

// Mounting.
/// Largest absolute sine of the angle between a chord and the road. A steeper one is too short to
/// give the direction of travel.
constexpr double kMaxSlope = 0.8;

/// [rad] Standard deviation of the initial roll, which is zero: cameras are mounted level by eye.
constexpr double kInitialRollSigma = 0.1;
/// [camera heights] Averaging length of pitch and roll: the load changes slowly.
constexpr double kForgettingDistance = 200;
/// [rad] Standard deviation of the vehicle's roll against the road (curves, camber).
constexpr double kRollMotionSigma = 0.012;

// Search for the visible band of the road.
constexpr double kBandHalfWidth = 1;                // [camera heights] about a lane
constexpr double kMinDistance = 1, kMaxAhead = 25;  // [camera heights]
constexpr double kOffsetStep = 0.25;                // [camera heights]
constexpr int kOffsetSteps = 40;                    // to either side
constexpr int kGridSize = 64;         // [rays] in a row and column of the image at most
constexpr double kRaySpacing = 0.03;  // [focal lengths] at least
/// Number of rays of a band, relative to the band with the most. The band on the path is used from
/// kVisibleShare on: with fewer, in a corner of the image, it shows too little road for a plane.
/// Otherwise the nearest band from kWellVisibleShare on is used.
constexpr double kVisibleShare = 0.25;
constexpr double kWellVisibleShare = 0.8;

/// Number of rays of a regular grid over the image that meet the road in each band.
using Histogram = std::array<int, 2 * kOffsetSteps + 1>;

/// Where a viewing ray meets the road, ahead and to the left of the point below the camera [camera
/// heights]. Empty: nowhere, farther along the path than max_ahead, or nearer than min_distance.
std::optional<Eigen::Vector2d> onRoad(const Eigen::Matrix3d& R_c_road, const Eigen::Vector3d& ray,
                                      double min_distance, double max_ahead) {
  const double down = -R_c_road.col(2).dot(ray);
  if (!(down > 0)) return std::nullopt;
  const double ahead = R_c_road.col(0).dot(ray) / down, left = R_c_road.col(1).dot(ray) / down;
  if (std::abs(ahead) > max_ahead) return std::nullopt;
  if (ahead * ahead + left * left < min_distance * min_distance) return std::nullopt;
  return Eigen::Vector2d(ahead, left);
}

bool givesDirection(const RoadPrior& prior, const Eigen::Vector3d& n_c) {
  return prior.chord && std::abs(n_c.dot(prior.chord->direction_c)) < kMaxSlope;
}

}  // namespace

Eigen::Vector3d roadNormal(double pitch, double roll) {
  return {-std::sin(roll), -std::cos(roll) * std::cos(pitch), -std::cos(roll) * std::sin(pitch)};
}

double pitchOf(const Eigen::Vector3d& n_c) { return std::atan2(-n_c.z(), -n_c.y()); }

double rollOf(const Eigen::Vector3d& n_c) { return -std::asin(std::clamp(n_c.x(), -1.0, 1.0)); }

Eigen::Matrix3d roadAxes(const Eigen::Vector3d& n_c, const Eigen::Vector3d& direction_c) {
  const Eigen::Vector3d ahead = (direction_c - n_c.dot(direction_c) * n_c).normalized();
  Eigen::Matrix3d R_c_road;
  R_c_road << ahead, n_c.cross(ahead), n_c;
  return R_c_road;
}

void RoadPrior::addTo(const Eigen::Vector3d& m, double height,
                      Eigen::Ref<Eigen::Matrix3d, 0, Eigen::OuterStride<>> H,
                      Eigen::Ref<Eigen::Vector3d> b) const {
  for (const auto& [axis, sigma] :
       {std::pair(forward_c, pitch_sigma), std::pair(lateral(), roll_sigma)}) {
    const Eigen::Vector3d jacobian = height * axis / sigma;
    H += jacobian * jacobian.transpose();
    b -= jacobian * jacobian.dot(m);
  }
}

LaneRegion::LaneRegion(const RoadPrior& prior, double height, double min_distance, double max_ahead,
                       double half_width)
    : R_c_road_(prior.axes()),
      offset_(prior.region_offset),
      min_distance_(min_distance),
      max_ahead_(max_ahead),
      half_width_(half_width) {
  if (prior.chord && height > 0) {
    chord_length_ = prior.chord->length / height;
    curvature_ = prior.n_c.dot(prior.chord->turn_c) / chord_length_;
  }
}

bool LaneRegion::contains(const Eigen::Vector3d& ray) const {
  const auto point = onRoad(R_c_road_, ray, min_distance_, max_ahead_);
  if (!point) return false;
  // Lateral position of the path relative to the chord, not to the tangent at the camera: the
  // parabola of the given curvature through both ends of the chord (ahead = 0 and -chord_length_).
  const double path = 0.5 * curvature_ * point->x() * (point->x() + chord_length_);
  return std::abs(point->y() - path - offset_) <= half_width_;
}

double visibleRegionOffset(const PinholeCamera& camera, const RoadPrior& prior) {
  Histogram visible{};
  const Eigen::Matrix3d R_c_road = prior.axes();
  const double step_x = std::max(kRaySpacing * camera.fx, 1.0 * camera.width / kGridSize);
  const double step_y = std::max(kRaySpacing * camera.fy, 1.0 * camera.height / kGridSize);
  for (double y = 0.5 * step_y; y < camera.height; y += step_y) {
    for (double x = 0.5 * step_x; x < camera.width; x += step_x) {
      const auto point = onRoad(R_c_road, camera.ray({x, y}), kMinDistance, kMaxAhead);
      if (!point) continue;
      const double limit = kOffsetSteps;
      const double first = std::max(std::ceil((point->y() - kBandHalfWidth) / kOffsetStep), -limit);
      const double last = std::min(std::floor((point->y() + kBandHalfWidth) / kOffsetStep), limit);
      for (double k = first; k <= last; ++k) ++visible[static_cast<std::size_t>(k + limit)];
    }
  }
  const int best = *std::max_element(visible.begin(), visible.end());
  if (visible[kOffsetSteps] >= kVisibleShare * best) return 0;
  for (int k = 1; k <= kOffsetSteps; ++k) {
    for (const int side : {1, -1}) {
      const int count = visible[static_cast<std::size_t>(kOffsetSteps + side * k)];
      if (count >= kWellVisibleShare * best) return side * k * kOffsetStep;
    }
  }
  return 0;
}

Mounting::Mounting(const Options& options) : options_(options) {
  covariance_.diagonal() << std::pow(kInitialRollSigma, 2), 0,
      std::pow(options_.initial_pitch_sigma, 2);
}

double Mounting::sigma() const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance_, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues().maxCoeff()));
}

/// Keeps the covariance in the tangent plane of the new normal.
void Mounting::setNormal(const Eigen::Vector3d& n_c) {
  n_c_ = n_c.normalized();
  const Eigen::Matrix3d tangent = Eigen::Matrix3d::Identity() - n_c_ * n_c_.transpose();
  covariance_ = tangent * covariance_ * tangent;
}

/// Kalman update with a measured tilt towards axis (unit, orthogonal to n_c_), given as its
/// tangent.
void Mounting::correct(const Eigen::Vector3d& axis, double tangent, double measurement_variance) {
  const Eigen::Vector3d gain = covariance_ * axis / (variance(axis) + measurement_variance);
  covariance_ -= gain * (axis.transpose() * covariance_).eval();
  setNormal(n_c_ + gain * tangent);
}

RoadPrior Mounting::prior(const CameraPath& path, double height) const {
  RoadPrior prior;
  prior.chord = path.chord(options_.chord_length_heights * height);
  const bool has_direction = givesDirection(prior, n_c_);
  const Eigen::Vector3d ahead = has_direction ? prior.chord->direction_c : Eigen::Vector3d::UnitZ();

  Mounting predicted = *this;
  Eigen::Matrix3d R_c_road = roadAxes(predicted.n_c_, ahead);  // columns: ahead, left, up
  predicted.covariance_ +=
      std::pow(options_.pitch_motion_sigma, 2) * R_c_road.col(0) * R_c_road.col(0).transpose();
  predicted.covariance_ +=
      kRollMotionSigma * kRollMotionSigma * R_c_road.col(1) * R_c_road.col(1).transpose();
  if (has_direction) {
    // Eq. 3 of Tian et al.: the road normal n is orthogonal to the direction of motion t, here that
    // of the chord. The measurement noise is the heave of the vehicle between the ends of the
    // chord; without a known height pitch_motion_sigma.
    const double chord_sigma = height > 0
                                   ? options_.heave_sigma_heights * height / prior.chord->length
                                   : options_.pitch_motion_sigma;
    predicted.correct(R_c_road.col(0), -predicted.n_c_.dot(ahead) / R_c_road.col(0).dot(ahead),
                      chord_sigma * chord_sigma);
    R_c_road = roadAxes(predicted.n_c_, ahead);
  }
  prior.n_c = predicted.n_c_;
  prior.forward_c = R_c_road.col(0);
  prior.pitch_sigma = std::sqrt(predicted.variance(prior.forward_c));
  prior.roll_sigma = std::sqrt(predicted.variance(prior.lateral()));
  return prior;
}

void Mounting::addSample(const Eigen::Vector3d& axis, double tangent, double sample_sigma,
                         double step_heights) {
  // Samples within one chord length are correlated; together they count as one.
  const double variance_heights =
      options_.chord_length_heights * sample_sigma * sample_sigma;  // for one camera height
  if (!(step_heights > 0) || !areFinite(step_heights, tangent)) return;
  // Lower bound of the variance: the mean forgets samples older than the forgetting distance.
  const double shortfall = variance_heights / kForgettingDistance - variance(axis);
  if (shortfall > 0) covariance_ += shortfall * axis * axis.transpose();
  correct(axis, tangent, variance_heights / step_heights);
  limitTilt();
}

void Mounting::limitTilt() {
  const double limit = options_.max_tilt_rad;
  if (std::abs(pitch()) <= limit && std::abs(roll()) <= limit) return;
  setNormal(roadNormal(std::clamp(pitch(), -limit, limit), std::clamp(roll(), -limit, limit)));
}

void Mounting::update(const RoadPrior& prior, const GroundPlane* plane, double step,
                      double height) {
  const bool has_direction = givesDirection(prior, n_c_);
  const Eigen::Vector3d ahead = has_direction ? prior.chord->direction_c : Eigen::Vector3d::UnitZ();
  if (plane != nullptr) {
    const Eigen::Vector3d left = roadAxes(n_c_, ahead).col(1);
    addSample(left, plane->n_c.dot(left) / plane->n_c.dot(n_c_), kRollMotionSigma, step / height);
  }
  if (has_direction) {
    const Eigen::Vector3d along = roadAxes(n_c_, ahead).col(0);
    const double chord_sigma = options_.heave_sigma_heights * height / prior.chord->length;
    addSample(along, -n_c_.dot(ahead) / along.dot(ahead),
              std::hypot(options_.pitch_motion_sigma, chord_sigma), step / height);
  }
}

std::string heightYaml(const std::string& source, double height, double error95) {
  return "# From " + source + ".\n" +
         format("camera_height: %.4f  # [m] ± %.4f (95 %%), %.2f %%\n", height, error95,
                100 * error95 / height) +
         "# The mounting of the camera, for tf; the scale does not need it.\n";
}

std::string mountingComments(double height, double pitch, double pitch95, double roll,
                             double roll95) {
  const auto degrees = [](double angle, double error95) {
    return format("%.2f ± %.2f (95 %%) deg", kDegreesPerRadian * angle,
                  kDegreesPerRadian * error95);
  };
  const Eigen::Matrix3d R_b_c = roadAxes(roadNormal(pitch, roll)).transpose();
  return "# pitch: " + degrees(pitch, pitch95) +
         ", positive looks down\n# roll: " + degrees(roll, roll95) +
         ", positive: the right of the camera is lower\n# A base_link on the road below the camera "
         "that faces as the camera does, with yaw, pitch and roll:\n" +
         format(
             "# rosrun tf2_ros static_transform_publisher 0 0 %.3f %.5f %.5f %.5f base_link "
             "CAMERA_FRAME\n",
             height, std::atan2(R_b_c(1, 0), R_b_c(0, 0)), -std::asin(R_b_c(2, 0)),
             std::atan2(R_b_c(2, 1), R_b_c(2, 2)));
}

}  // namespace gsv
