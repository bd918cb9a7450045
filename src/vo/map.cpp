#include "vo/map.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace ground_scale_vo {
namespace {

/// [VO units^2] minimum information (1 / sigma^2) on the inverse depth; below it there is no
/// baseline.
constexpr double kMinInformation = 1e-12;
/// Gauss-Newton starts at the linear solution and converges in two or three iterations.
constexpr int kMaxTriangulationIterations = 8;
/// [standard deviations of the inverse depth] step length at convergence.
constexpr double kConvergedSigmas = 1e-3;

/// Largest sigma of a new inverse depth, relative to the inverse depth: with more, the depth is
/// hardly known, and the next keyframe halves it.
constexpr double kMaxRelativeSigma = 0.35;
/// [normalised image coordinates] largest error of any observation of a new depth: 3 px at a focal
/// length of 718, several standard deviations of a tracked corner.
constexpr double kMaxNewPointError = 0.004;

/// The current poses of all keyframes relative to the earlier ones, in which landmarks are
/// anchored.
class RelativePoses {
 public:
  explicit RelativePoses(const std::deque<Keyframe>& keyframes)
      : first_id_(keyframes.empty() ? 0 : keyframes.front().id), size_(keyframes.size()) {
    T_c_a_.resize(size_ * size_);
    for (std::size_t c = 1; c < size_; ++c) {
      const Eigen::Isometry3d T_c_w = keyframes[c].T_w_c.inverse();
      for (std::size_t a = 0; a < c; ++a) T_c_a_[c * size_ + a] = T_c_w * keyframes[a].T_w_c;
    }
  }

  /// For an observation of the landmark other than its anchor's.
  const Eigen::Isometry3d& T_c_anchor(const Observation& o, const Landmark& landmark) const {
    const std::uint32_t anchor = landmark.observations.front().keyframe;
    return T_c_a_[(o.keyframe - first_id_) * size_ + (anchor - first_id_)];
  }

 private:
  std::uint32_t first_id_;
  std::size_t size_;
  std::vector<Eigen::Isometry3d> T_c_a_;
};

}  // namespace

std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations) {
  if (observations.empty()) return std::nullopt;

  // In camera c the point is, up to scale, a + rho t with a = R ray. Initialise with the linear
  // solution of x (a + rho t)_z = (a + rho t)_xy.
  double numerator = 0, denominator = 0;
  for (const RayObservation& o : observations) {
    const Eigen::Vector3d a = o.T_c_anchor.linear() * ray;
    const Eigen::Vector3d& t = o.T_c_anchor.translation();
    const Eigen::Vector2d coefficient = o.x * t.z() - t.head<2>();
    const double weight = 1 / (o.sigma * o.sigma);
    numerator += weight * coefficient.dot(a.head<2>() - o.x * a.z());
    denominator += weight * coefficient.squaredNorm();
  }
  if (denominator < kMinInformation) return std::nullopt;
  double rho = numerator / denominator;

  double information = 0;
  for (int iteration = 0; iteration < kMaxTriangulationIterations; ++iteration) {
    double gradient = 0;
    information = 0;
    for (const RayObservation& o : observations) {
      const auto [p, scaled_derivative] = projectOnRay(ray, rho, o.T_c_anchor);
      if (p.z() < kMinObserverDepthRatio) return std::nullopt;
      const Eigen::Vector2d residual = p.head<2>() / p.z() - o.x;
      const Eigen::Vector2d J = scaled_derivative / p.z();
      const double weight = 1 / (o.sigma * o.sigma);
      gradient += weight * J.dot(residual);
      information += weight * J.squaredNorm();
    }
    if (information < kMinInformation) return std::nullopt;
    const double step = gradient / information;
    rho -= step;
    if (!areFinite(rho, information)) return std::nullopt;
    if (std::abs(step) < kConvergedSigmas / std::sqrt(information)) {
      return InverseDepth{rho, 1 / std::sqrt(information)};
    }
  }
  return std::nullopt;
}

std::vector<Observation> observationsOf(const PinholeCamera& camera,
                                        const std::vector<Feature>& features) {
  std::vector<Observation> observations;
  observations.reserve(features.size());
  for (const Feature& feature : features) {
    observations.push_back({feature.id, camera.ray(feature.atStamp()).head<2>(),
                            std::hypot(feature.sigma, feature.to_stamp_sigma), feature.to_stamp});
  }
  return observations;
}

void LocalMap::clear() {
  keyframes_.clear();
  landmarks_.clear();
}

std::uint32_t LocalMap::addKeyframe(const Eigen::Isometry3d& T_w_c,
                                    const std::vector<Observation>& corners, const cv::Mat& image) {
  const std::uint32_t id = keyframes_.empty() ? 0 : keyframes_.back().id + 1;
  keyframes_.push_back({id, T_w_c, image, 1, corners.size()});
  for (const Observation& corner : corners) {
    std::vector<Observation>& observations = landmarks_[corner.id].observations;
    observations.push_back(corner);
    observations.back().keyframe = id;
  }
  if (keyframes_.size() > kMaxKeyframes) dropOldestKeyframe();
  return id;
}

void LocalMap::dropOldestKeyframe() {
  const std::uint32_t dropped = keyframes_.front().id;
  const std::uint32_t newest = keyframes_.back().id;
  landmarks_.removeIf([&](Landmark& landmark) {
    const bool anchored = landmark.observations.front().keyframe == dropped;
    const auto world = anchored ? point(landmark) : std::nullopt;
    if (anchored) landmark.observations.erase(landmark.observations.begin());
    const bool tracked =
        !landmark.observations.empty() && landmark.observations.back().keyframe == newest;
    // No longer tracked, and cannot constrain a pose.
    if (!tracked && landmark.observations.size() < 2) return true;
    if (world) landmark.depth = depthInAnchor(landmark, *world);
    return false;
  });
  keyframes_.pop_front();
}

void LocalMap::removeNewestKeyframe() {
  const std::uint32_t removed = keyframes_.back().id;
  landmarks_.removeIf([&](Landmark& landmark) {
    std::vector<Observation>& observations = landmark.observations;
    if (observations.back().keyframe == removed) observations.pop_back();
    return observations.empty();
  });
  keyframes_.pop_back();
}

/// Empty when the point is behind the anchor keyframe's camera.
std::optional<InverseDepth> LocalMap::depthInAnchor(const Landmark& landmark,
                                                    const WorldPoint& world) const {
  const Eigen::Isometry3d T_c_w = keyframe(landmark.observations.front().keyframe).T_w_c.inverse();
  const double z = (T_c_w * world.p_w).z();
  if (!(z > 0)) return std::nullopt;
  // The sigma of the whole vector bounds the sigma of z, with which the results are not better.
  const double z_sigma = (T_c_w.linear() * world.sigma_w).norm();
  return InverseDepth{1 / z, z_sigma / (z * z)};
}

void LocalMap::triangulateNew() {
  const RelativePoses poses(keyframes_);
  std::vector<RayObservation> observations;
  for (auto& [id, landmark] : landmarks_) {
    if (landmark.depth || landmark.observations.size() < 2) continue;
    observations.clear();
    for (auto o = std::next(landmark.observations.begin()); o != landmark.observations.end(); ++o) {
      observations.push_back({poses.T_c_anchor(*o, landmark), o->x, o->sigma});
    }
    const Eigen::Vector3d ray = landmark.ray();
    const auto depth = triangulate(ray, observations);
    if (!depth || depth->value <= 0) continue;
    if (depth->sigma > kMaxRelativeSigma * depth->value) continue;
    const bool fits = std::all_of(observations.begin(), observations.end(), [&](const auto& o) {
      return reprojectionError(projectOnRay(ray, depth->value, o.T_c_anchor).p, o.x) <
             kMaxNewPointError;
    });
    if (fits) landmark.depth = depth;
  }
}

void LocalMap::updateSigmas() {
  const RelativePoses poses(keyframes_);
  for (auto& [id, landmark] : landmarks_) {
    if (!landmark.depth) continue;
    const Eigen::Vector3d ray = landmark.ray();
    double information = 0;
    for (auto o = std::next(landmark.observations.begin()); o != landmark.observations.end(); ++o) {
      const auto [p, scaled_derivative] =
          projectOnRay(ray, landmark.depth->value, poses.T_c_anchor(*o, landmark));
      if (p.z() < kMinObserverDepthRatio) continue;
      information += (scaled_derivative / (p.z() * o->sigma)).squaredNorm();
    }
    // No observation but the anchor's (the others were dropped with their keyframes): keep sigma.
    if (information > 0) {
      // A single remaining observation has less information than those that were dropped.
      const double sigma = 1 / std::sqrt(information);
      landmark.depth->sigma =
          landmark.observations.size() < 3 ? std::min(sigma, landmark.depth->sigma) : sigma;
    }
  }
}

void LocalMap::removeOutliers(double max_reprojection_error) {
  const RelativePoses poses(keyframes_);
  landmarks_.removeIf([&](Landmark& landmark) {
    if (!landmark.depth) return false;
    if (landmark.depth->value <= 0) return true;
    const Eigen::Vector3d ray = landmark.ray();
    std::vector<Observation>& observations = landmark.observations;
    const auto kept = std::remove_if(
        std::next(observations.begin()), observations.end(), [&](const Observation& o) {
          const Eigen::Isometry3d& T_c_anchor = poses.T_c_anchor(o, landmark);
          const Eigen::Vector3d p = projectOnRay(ray, landmark.depth->value, T_c_anchor).p;
          return reprojectionError(p, o.x) > max_reprojection_error;
        });
    const bool removed = kept != observations.end();
    observations.erase(kept, observations.end());
    return removed && observations.size() < 2;
  });
}

Landmark* LocalMap::find(std::uint64_t id) {
  const auto it = landmarks_.find(id);
  return it == landmarks_.end() ? nullptr : &it->second;
}

std::optional<WorldPoint> LocalMap::point(std::uint64_t id) const {
  const auto it = landmarks_.find(id);
  return it == landmarks_.end() ? std::nullopt : point(it->second);
}

std::optional<WorldPoint> LocalMap::point(const Landmark& landmark) const {
  if (!landmark.depth || landmark.depth->value <= 0) return std::nullopt;
  const Eigen::Isometry3d& T_w_a = keyframe(landmark.observations.front().keyframe).T_w_c;
  const double rho = landmark.depth->value;
  const Eigen::Vector3d ray = landmark.ray();
  return WorldPoint{T_w_a * (ray / rho),
                    T_w_a.linear() * ray * (landmark.depth->sigma / (rho * rho))};
}

}  // namespace ground_scale_vo
