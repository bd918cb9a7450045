#include "vo/mapping.hpp"

#include <cmath>
#include <limits>

#include "common/time.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "vo/motion.hpp"

namespace gsv {
namespace {

/// Median parallax between two keyframes, as a share of that which calls for the next keyframe,
/// below which both were taken at the same place: about the noise of a feature's position.
constexpr double kMinParallaxShare = 0.05;

}  // namespace

/// Number of the features that the last keyframe also observes, and their median parallax to it
/// [rad], at most pi / 2.
std::pair<std::size_t, double> Mapping::parallaxToLast(const Eigen::Isometry3d& T_w_c,
                                                       const std::vector<Feature>& found) const {
  const Keyframe& last = map_.keyframes().back();
  const Eigen::Matrix3d R_c_k = T_w_c.linear().transpose() * last.T_w_c.linear();
  // The tangent grows with the angle, so the median angle is that of the median tangent.
  std::vector<double> squared_tangents;
  squared_tangents.reserve(found.size());
  for (const Feature& feature : found) {
    const Landmark* const landmark = map_.find(feature.id);
    if (!landmark || landmark->observations.back().keyframe != last.id) continue;
    const Eigen::Vector3d rotated = R_c_k * landmark->observations.back().x.homogeneous();
    const Eigen::Vector3d ray = camera_.ray(feature.atStamp());
    const double dot = rotated.dot(ray);
    squared_tangents.push_back(dot > 0 ? rotated.cross(ray).squaredNorm() / (dot * dot)
                                       : std::numeric_limits<double>::infinity());
  }
  const std::size_t count = squared_tangents.size();
  return {count, count > 0 ? std::atan(std::sqrt(median(&squared_tangents))) : 0};
}

bool Mapping::needsKeyframe(const Eigen::Isometry3d& T_w_c,
                            const std::vector<Feature>& found) const {
  const auto [tracked, parallax] = parallaxToLast(T_w_c, found);
  if (tracked == 0 || parallax > kKeyframeParallax) return true;
  return static_cast<double>(tracked) <
         kKeyframeMinTracked * static_cast<double>(map_.keyframes().back().corners);
}

void Mapping::addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Feature>& features,
                          const ImagePyramid& image, const Vector6d& readout_motion) {
  if (!map_.keyframes().back().has_parallax) map_.removeNewestKeyframe();
  const auto [tracked, parallax] = parallaxToLast(T_w_c, features);
  map_.addKeyframe(T_w_c, observationsOf(camera_, features), image.image);
  Keyframe& keyframe = map_.keyframes().back();
  keyframe.exposure = image.exposure;
  keyframe.readout_motion = readout_motion;
  keyframe.has_parallax = tracked == 0 || parallax > kMinParallaxShare * kKeyframeParallax;
  map_.triangulateNew();
  if (readout_time_ > 0) shiftObservations(camera_, &map_);
  bundle_adjustment_.load(map_);
  adjusting_ = std::async(std::launch::async, [this] {
    const Stopwatch watch;
    bundle_adjustment_.solve();
    return watch.ms();
  });
}

std::optional<Eigen::Isometry3d> Mapping::applyAdjustment(double* duration_ms) {
  if (!adjusting_.valid()) return std::nullopt;
  *duration_ms = adjusting_.get();
  const Eigen::Isometry3d before = map_.keyframes().back().T_w_c;
  storeAdjusted();
  return map_.keyframes().back().T_w_c * before.inverse();
}

bool Mapping::adjustNow() {
  bundle_adjustment_.load(map_);
  const bool usable = bundle_adjustment_.solve();
  storeAdjusted();
  return usable;
}

void Mapping::storeAdjusted() {
  bundle_adjustment_.store(&map_);
  map_.removeOutliers();
  map_.updateSigmas();
}

}  // namespace gsv
