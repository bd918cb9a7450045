#include "vo/motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "common/time.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// Limits the prediction to this many times the interval over which the velocity was measured.
/// Two stamps that are closer together than their images give a wrong velocity; and after a long
/// interruption, objects that move along and the distant scene could fit a wrong predicted pose.
/// The value lies between an interruption after which tracking resumes in the tests (10 black
/// images) and one that needs a new map (41 black images behind a car).
constexpr double kMaxPredictedSteps = 12;

// The grid over the image in which unknown depths are taken from their neighbours': a cell of a
// KITTI image is 78 x 47 px, and 3 points suffice for a median that one outlier does not move.
constexpr int kColumns = 16, kRows = 8;
constexpr std::size_t kMinPointsPerCell = 3;

/// Minimum z of a predicted point; one with less keeps its pixel. Of a map point in VO units (the
/// unit is the median depth at the start of the map), of any other relative to its guessed depth in
/// the previous camera.
constexpr double kMinDepth = 1e-3;

/// The median inverse depth of the known points around each feature, in its cell of the grid.
/// known: inverse depths of the features; 0: unknown.
std::vector<double> medianInverseDepths(const PinholeCamera& camera,
                                        const std::vector<Feature>& features,
                                        const std::vector<double>& known) {
  const auto cellOf = [&](const Eigen::Vector2d& u) {
    const int column =
        std::clamp(static_cast<int>(u.x() * kColumns / camera.width), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(u.y() * kRows / camera.height), 0, kRows - 1);
    return static_cast<std::size_t>(row * kColumns + column);
  };
  std::array<std::vector<double>, kColumns * kRows> in_cell;
  std::vector<double> all;
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (known[i] <= 0) continue;
    in_cell[cellOf(features[i].u)].push_back(known[i]);
    all.push_back(known[i]);
  }
  std::array<double, kColumns * kRows> medians;
  medians.fill(all.empty() ? 0 : median(&all));
  for (std::size_t i = 0; i < in_cell.size(); ++i) {
    if (in_cell[i].size() >= kMinPointsPerCell) medians[i] = median(&in_cell[i]);
  }
  std::vector<double> result;
  result.reserve(features.size());
  for (const Feature& feature : features) result.push_back(medians[cellOf(feature.u)]);
  return result;
}

}  // namespace

Eigen::Isometry3d MotionModel::predict(std::int64_t stamp_ns) const {
  const double dt = secondsBetween(pose_.stamp_ns, stamp_ns);
  return boxplus(pose_.T_w_c, velocity_ * std::min(dt, kMaxPredictedSteps * velocity_dt_));
}

Eigen::Isometry3d MotionModel::extrapolate(std::int64_t stamp_ns) const {
  const double dt = secondsBetween(pose_.stamp_ns, stamp_ns);
  return boxplus(pose_.T_w_c, long_velocity_ * dt);
}

double MotionModel::stepsSince(std::int64_t stamp_ns) const {
  return long_dt_ > 0 ? secondsBetween(pose_.stamp_ns, stamp_ns) / long_dt_ : 0;
}

Vector6d MotionModel::velocity() const {
  // velocity_ is the direction of the chord between two poses in the axes of the first. On an arc
  // the camera has turned by half of the rotation from the chord to the second.
  Vector6d velocity = velocity_;
  velocity.tail<3>() = motionFrom(-0.5 * velocity_dt_ * velocity_).linear() * velocity_.tail<3>();
  return velocity;
}

void MotionModel::update(const StampedPose& pose) {
  const double dt = secondsBetween(pose_.stamp_ns, pose.stamp_ns);
  if (dt > 0) {
    const Eigen::Isometry3d step = pose_.T_w_c.inverse() * pose.T_w_c;
    const Eigen::AngleAxisd rotation(step.linear());
    Vector6d velocity;
    velocity << rotation.angle() / dt * rotation.axis(), step.translation() / dt;
    const bool is_irregular = velocity_dt_ > 0 && areUnequal(dt, velocity_dt_);
    long_dt_ = is_irregular ? velocity_dt_ + dt : dt;
    long_velocity_ = velocity;
    if (is_irregular) long_velocity_ = (velocity_dt_ * velocity_ + dt * velocity) / long_dt_;
    if (velocity_dt_ > 0) rotation_rate_change_ = (velocity - velocity_).head<3>().norm();
    velocity_ = velocity;
    velocity_dt_ = dt;
  }
  pose_ = pose;
}

std::vector<cv::Point2f> predictPixels(const PinholeCamera& camera, const LocalMap& map,
                                       const std::vector<Feature>& features,
                                       const Eigen::Isometry3d& T_w_previous,
                                       const Eigen::Isometry3d& T_w_next) {
  const Eigen::Isometry3d T_previous_w = T_w_previous.inverse();
  const Eigen::Isometry3d T_next_w = T_w_next.inverse();
  const Eigen::Isometry3d T_next_previous = T_next_w * T_w_previous;
  std::vector<std::optional<WorldPoint>> points;
  std::vector<double> inverse_depths;  // in the previous camera; 0: unknown
  for (const Feature& feature : features) {
    points.push_back(map.point(feature.id));
    const double z = points.back() ? (T_previous_w * points.back()->p_w).z() : 0;
    inverse_depths.push_back(z > 0 ? 1 / z : 0);
  }
  const auto guesses = medianInverseDepths(camera, features, inverse_depths);
  std::vector<cv::Point2f> predicted;
  predicted.reserve(features.size());
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Eigen::Vector2d& u = features[i].u;
    const Eigen::Vector3d p = points[i]
                                  ? Eigen::Vector3d(T_next_w * points[i]->p_w)
                                  : Eigen::Vector3d(T_next_previous.linear() * camera.ray(u) +
                                                    guesses[i] * T_next_previous.translation());
    Eigen::Vector2d next = u;
    if (p.z() > kMinDepth) next = camera.project(p);
    if (p.z() > kMinDepth && points[i]) next -= features[i].to_stamp;
    predicted.push_back(toCv(next));
  }
  return predicted;
}

std::vector<cv::Point2f> predictPixelsByFlow(const std::vector<Feature>& features, double dt) {
  std::vector<cv::Point2f> predicted;
  predicted.reserve(features.size());
  for (const Feature& feature : features) predicted.push_back(toCv(feature.u + dt * feature.flow));
  return predicted;
}

void shiftFeatures(const PinholeCamera& camera, const LocalMap& map, const Eigen::Isometry3d& T_w_c,
                   const Vector6d& readout_motion, double readout_angle_sigma,
                   std::vector<Feature>* features) {
  const auto pixelsAt = [&](double share) {
    return predictPixels(camera, map, *features, T_w_c, boxplus(T_w_c, share * readout_motion));
  };
  const auto first = pixelsAt(-0.5), middle = pixelsAt(0), last = pixelsAt(0.5);
  for (std::size_t i = 0; i < features->size(); ++i) {
    Feature& feature = (*features)[i];
    const double share = camera.readoutShare(feature.u.y());
    // The parabola through the positions at the three times.
    const cv::Point2f flow = last[i] - first[i];
    const cv::Point2f acceleration = 2 * (first[i] - 2 * middle[i] + last[i]);
    feature.to_stamp =
        -share * Eigen::Vector2d(flow.x + share * acceleration.x, flow.y + share * acceleration.y);
    feature.to_stamp_sigma = std::abs(share) * readout_angle_sigma;
  }
}

void shiftObservations(const PinholeCamera& camera, LocalMap* map) {
  std::vector<Eigen::Isometry3d> T_k_w;
  for (const Keyframe& keyframe : map->keyframes()) T_k_w.push_back(keyframe.T_w_c.inverse());
  for (Landmark& landmark : map->landmarks()) {
    const auto point = map->point(landmark);
    if (!point) continue;
    for (Observation& o : landmark.observations) {
      const Keyframe& keyframe = map->keyframe(o.keyframe);
      const Eigen::Vector3d p_k = T_k_w[map->indexOf(keyframe.id)] * point->p_w;
      const Eigen::Vector2d u = camera.project(o.x.homogeneous()) - o.to_stamp;
      const Eigen::Isometry3d T_k_row =
          motionFrom(camera.readoutShare(u.y()) * keyframe.readout_motion);
      const Eigen::Vector3d p_row = T_k_row.inverse() * p_k;
      if (p_k.z() < kMinDepth || p_row.z() < kMinDepth) continue;
      o.to_stamp = camera.project(p_k) - camera.project(p_row);
      o.x = camera.ray(u + o.to_stamp).head<2>();
    }
  }
}

void shiftFeaturesByFlow(const PinholeCamera& camera, double readout_time, double dt,
                         std::vector<Feature>* features) {
  for (Feature& feature : *features) {
    const double previous_v = feature.u.y() - dt * feature.flow.y();
    const double delay = readout_time * camera.readoutShare(feature.u.y());
    const double exposures_dt = dt + delay - readout_time * camera.readoutShare(previous_v);
    if (exposures_dt > 0) feature.flow *= dt / exposures_dt;
    feature.to_stamp = -delay * feature.flow;
  }
}

}  // namespace gsv
