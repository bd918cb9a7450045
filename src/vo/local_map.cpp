#include "ground_scale_vo/vo/local_map.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

/// Distance between the observation and the point's projection, infinite behind the camera.
double reprojectionError(const Eigen::Vector3d& ray, double inverse_depth,
                         const RayObservation& o) {
  const Eigen::Vector3d p = projectOnRay(ray, inverse_depth, o.T_c_anchor).p;
  if (p.z() <= kMinDepthRatio) return std::numeric_limits<double>::infinity();
  return (p.head<2>() / p.z() - o.x).norm();
}

/// The observations of a map's landmarks relative to their anchors, with the current poses.
class AnchoredObservations {
 public:
  explicit AnchoredObservations(const LocalMap& map) : map_(map) {
    for (const Keyframe& keyframe : map.keyframes()) T_c_w_.push_back(keyframe.T_w_c.inverse());
  }

  /// Excludes the observation in the anchor keyframe. Valid until the next call.
  const std::vector<RayObservation>& of(const Landmark& landmark) {
    const auto& seen = landmark.observations;
    const std::uint32_t first_id = map_.keyframes().front().id;
    const Eigen::Isometry3d& T_w_a = map_.keyframe(seen.front().keyframe).T_w_c;
    observations_.clear();
    for (auto o = std::next(seen.begin()); o != seen.end(); ++o) {
      observations_.push_back({T_c_w_[o->keyframe - first_id] * T_w_a, o->x, o->sigma});
    }
    return observations_;
  }

 private:
  const LocalMap& map_;
  std::vector<Eigen::Isometry3d> T_c_w_;
  std::vector<RayObservation> observations_;
};

}  // namespace

void LocalMap::Options::validate() const { visitParameters(*this, RangeCheck("map/")); }

LocalMap::LocalMap(const Options& options) : options_(options) { options_.validate(); }

void LocalMap::clear() {
  keyframes_.clear();
  landmarks_.clear();
}

std::uint32_t LocalMap::addKeyframe(const Eigen::Isometry3d& T_w_c,
                                    const std::vector<Corner>& corners, const cv::Mat& image) {
  const std::uint32_t id = keyframes_.empty() ? 0 : keyframes_.back().id + 1;
  keyframes_.push_back({id, T_w_c, image, 1, corners.size()});
  for (const Corner& corner : corners) {
    landmarks_[corner.id].observations.push_back({id, corner.x, corner.sigma});
  }
  if (keyframes_.size() > static_cast<std::size_t>(options_.keyframes)) dropOldestKeyframe();
  return id;
}

void LocalMap::dropOldestKeyframe() {
  const std::uint32_t dropped = keyframes_.front().id;
  const std::uint32_t newest = keyframes_.back().id;
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    Landmark& landmark = it->second;
    const bool anchored = landmark.observations.front().keyframe == dropped;
    const auto world = anchored ? point(landmark) : std::nullopt;
    if (anchored) landmark.observations.erase(landmark.observations.begin());
    const bool tracked =
        !landmark.observations.empty() && landmark.observations.back().keyframe == newest;
    if (!tracked && landmark.observations.size() < 2) {
      it = landmarks_.erase(it);  // no longer tracked, and cannot constrain a pose
      continue;
    }
    if (world) landmark.depth = depthInAnchor(landmark, *world);
    ++it;
  }
  keyframes_.pop_front();
}

void LocalMap::removeNewestKeyframe() {
  const std::uint32_t removed = keyframes_.back().id;
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    std::vector<Observation>& observations = it->second.observations;
    if (observations.back().keyframe == removed) observations.pop_back();
    it = observations.empty() ? landmarks_.erase(it) : std::next(it);
  }
  keyframes_.pop_back();
}

/// Empty when the point is behind the anchor keyframe's camera.
std::optional<InverseDepth> LocalMap::depthInAnchor(const Landmark& landmark,
                                                    const WorldPoint& world) const {
  const Eigen::Isometry3d T_c_w = keyframe(landmark.observations.front().keyframe).T_w_c.inverse();
  const double z = (T_c_w * world.p_w).z();
  if (!(z > 0)) return std::nullopt;
  // Of the whole vector, an upper bound of that of z. With that of z the results are not better.
  const double z_sigma = (T_c_w.linear() * world.sigma_w).norm();
  return InverseDepth{1 / z, z_sigma / (z * z)};
}

void LocalMap::triangulateNew() {
  AnchoredObservations anchored(*this);
  for (auto& [id, landmark] : landmarks_) {
    if (landmark.depth || landmark.observations.size() < 2) continue;
    const auto& observations = anchored.of(landmark);
    const Eigen::Vector3d ray = landmark.ray();
    const auto depth = triangulate(ray, observations);
    if (!depth || depth->value <= 0) continue;
    if (depth->sigma > options_.max_relative_sigma * depth->value) continue;
    const bool fits = std::all_of(observations.begin(), observations.end(), [&](const auto& o) {
      return reprojectionError(ray, depth->value, o) < options_.max_reprojection_error;
    });
    if (fits) landmark.depth = depth;
  }
}

void LocalMap::updateSigmas() {
  AnchoredObservations anchored(*this);
  for (auto& [id, landmark] : landmarks_) {
    if (!landmark.depth) continue;
    const Eigen::Vector3d ray = landmark.ray();
    double information = 0;
    for (const RayObservation& o : anchored.of(landmark)) {
      const auto [p, scaled_derivative] = projectOnRay(ray, landmark.depth->value, o.T_c_anchor);
      if (p.z() < kMinDepthRatio) continue;
      information += (scaled_derivative / (p.z() * o.sigma)).squaredNorm();
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
  AnchoredObservations anchored(*this);
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    Landmark& landmark = it->second;
    if (!landmark.depth) {
      ++it;
      continue;
    }
    if (landmark.depth->value <= 0) {
      it = landmarks_.erase(it);
      continue;
    }
    const Eigen::Vector3d ray = landmark.ray();
    const auto& observations = anchored.of(landmark);
    std::size_t kept = 1;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      if (reprojectionError(ray, landmark.depth->value, observations[i]) > max_reprojection_error) {
        continue;
      }
      landmark.observations[kept++] = landmark.observations[i + 1];
    }
    const std::size_t before = landmark.observations.size();
    landmark.observations.resize(kept);
    if (kept < before && kept < 2) {
      it = landmarks_.erase(it);
    } else {
      ++it;
    }
  }
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
