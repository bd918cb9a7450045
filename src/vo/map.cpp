#include "vo/map.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

/// Largest sigma of a new inverse depth, relative to the inverse depth. The point still constrains
/// poses perpendicular to its epipolar line.
constexpr double kMaxRelativeSigma = 0.35;
/// [normalised image coordinates] largest error of any observation of a new depth: 3 px at a focal
/// length of 718. More than kMaxAdjustedError: the newest pose is not adjusted yet.
constexpr double kMaxNewPointError = 0.004;

/// [VO units^2] minimum information (1 / sigma^2) on the inverse depth; below it there is no
/// baseline.
constexpr double kMinInformation = 1e-12;
/// Gauss-Newton starts at the linear solution and converges in two or three iterations.
constexpr int kMaxTriangulationIterations = 8;
/// [standard deviations of the inverse depth] step length at convergence.
constexpr double kConvergedSigmas = 1e-3;

}  // namespace

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

double reprojectionError(const Eigen::Vector3d& p, const Eigen::Vector2d& x) {
  return p.z() > kMinObserverDepthRatio ? (p.head<2>() / p.z() - x).norm()
                                        : std::numeric_limits<double>::infinity();
}

std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<Eigen::Isometry3d>& T_c_anchor,
                                        const std::vector<Observation>& observations) {
  if (observations.empty()) return std::nullopt;

  // In camera c the point is, up to scale, a + rho t with a = R ray. Initialise with the linear
  // solution of x (a + rho t)_z = (a + rho t)_xy.
  double numerator = 0, denominator = 0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Observation& o = observations[i];
    const Eigen::Vector3d a = T_c_anchor[i].linear() * ray;
    const Eigen::Vector3d& t = T_c_anchor[i].translation();
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
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const Observation& o = observations[i];
      const Eigen::Vector3d p = projectOnRay(ray, rho, T_c_anchor[i]);
      if (p.z() < kMinObserverDepthRatio) return std::nullopt;
      const Eigen::Vector2d residual = p.head<2>() / p.z() - o.x;
      const Eigen::Vector2d J = depthDerivative(p, T_c_anchor[i]) / p.z();
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

void LocalMap::clear() { *this = {}; }

/// Rebuilds index_of_.
void LocalMap::numberLandmarks() {
  index_of_.clear();
  if (landmarks_.empty()) return;
  first_id_ = landmarks_.front().id();
  index_of_.assign(landmarks_.back().id() - first_id_ + 1, -1);
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    index_of_[landmarks_[i].id() - first_id_] = static_cast<std::int32_t>(i);
  }
}

const Landmark* LocalMap::find(std::uint64_t id) const {
  if (id < first_id_ || id - first_id_ >= index_of_.size()) return nullptr;
  const std::int32_t index = index_of_[id - first_id_];
  return index < 0 ? nullptr : &landmarks_[static_cast<std::size_t>(index)];
}

Landmark* LocalMap::find(std::uint64_t id) {
  return const_cast<Landmark*>(std::as_const(*this).find(id));
}

/// Removes the landmarks for which remove(Landmark*), which may change them, is true.
template <typename Remove>
void LocalMap::removeLandmarks(const Remove& remove) {
  auto kept = landmarks_.begin();
  for (Landmark& landmark : landmarks_) {
    if (remove(&landmark)) continue;
    if (&*kept != &landmark) *kept = std::move(landmark);
    ++kept;
  }
  landmarks_.erase(kept, landmarks_.end());
  numberLandmarks();
}

void LocalMap::addKeyframe(const Eigen::Isometry3d& T_w_c,
                           const std::vector<Observation>& observations, const cv::Mat& image) {
  const std::uint32_t id = keyframes_.empty() ? 0 : keyframes_.back().id + 1;
  keyframes_.push_back({id, T_w_c, image, 1, observations.size()});
  const auto known = static_cast<std::ptrdiff_t>(landmarks_.size());
  for (const Observation& observation : observations) {
    Landmark* landmark = find(observation.id);
    if (!landmark) landmark = &landmarks_.emplace_back();
    landmark->observations.push_back(observation);
    landmark->observations.back().keyframe = id;
  }
  std::inplace_merge(landmarks_.begin(), landmarks_.begin() + known, landmarks_.end(),
                     [](const Landmark& a, const Landmark& b) { return a.id() < b.id(); });
  numberLandmarks();
  if (keyframes_.size() > kMaxKeyframes) dropOldestKeyframe();
}

void LocalMap::dropOldestKeyframe() {
  const std::uint32_t dropped = keyframes_.front().id;
  const std::uint32_t newest = keyframes_.back().id;
  removeLandmarks([&](Landmark* landmark) {
    std::vector<Observation>& observations = landmark->observations;
    const bool anchored = observations.front().keyframe == dropped;
    const auto world = anchored ? point(*landmark) : std::nullopt;
    if (anchored) observations.erase(observations.begin());
    const bool tracked = !observations.empty() && observations.back().keyframe == newest;
    // No longer tracked, and cannot constrain a pose.
    if (!tracked && observations.size() < 2) return true;
    if (world) landmark->depth = depthInAnchor(*landmark, *world);
    return false;
  });
  keyframes_.pop_front();
}

void LocalMap::removeNewestKeyframe() {
  const std::uint32_t removed = keyframes_.back().id;
  removeLandmarks([&](Landmark* landmark) {
    std::vector<Observation>& observations = landmark->observations;
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

/// T_c_a of all keyframes c and the earlier ones a, in which landmarks are anchored, at
/// [c * keyframes + a].
std::vector<Eigen::Isometry3d> LocalMap::relativePoses() const {
  const std::size_t n = keyframes_.size();
  std::vector<Eigen::Isometry3d> T_c_a(n * n);
  for (std::size_t c = 1; c < n; ++c) {
    const Eigen::Isometry3d T_c_w = keyframes_[c].T_w_c.inverse();
    for (std::size_t a = 0; a < c; ++a) T_c_a[c * n + a] = T_c_w * keyframes_[a].T_w_c;
  }
  return T_c_a;
}

/// For an observation of the landmark other than its anchor's.
const Eigen::Isometry3d& LocalMap::poseOfAnchor(const std::vector<Eigen::Isometry3d>& T_c_a,
                                                const Observation& o,
                                                const Landmark& landmark) const {
  const std::uint32_t anchor = landmark.observations.front().keyframe;
  return T_c_a[indexOf(o.keyframe) * keyframes_.size() + indexOf(anchor)];
}

void LocalMap::triangulateNew() {
  const auto poses = relativePoses();
  std::vector<Eigen::Isometry3d> T_c_anchor;
  std::vector<Observation> observations;  // without the anchor's
  for (Landmark& landmark : landmarks_) {
    if (landmark.depth || landmark.observations.size() < 2) continue;
    observations.assign(std::next(landmark.observations.begin()), landmark.observations.end());
    T_c_anchor.clear();
    for (const Observation& o : observations) {
      T_c_anchor.push_back(poseOfAnchor(poses, o, landmark));
    }
    const Eigen::Vector3d ray = landmark.ray();
    const auto depth = triangulate(ray, T_c_anchor, observations);
    if (!depth || depth->value <= 0) continue;
    if (depth->sigma > kMaxRelativeSigma * depth->value) continue;
    bool fits = true;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const Eigen::Vector3d p = projectOnRay(ray, depth->value, T_c_anchor[i]);
      fits = fits && reprojectionError(p, observations[i].x) < kMaxNewPointError;
    }
    if (fits) landmark.depth = depth;
  }
}

void LocalMap::updateSigmas() {
  const auto poses = relativePoses();
  for (Landmark& landmark : landmarks_) {
    if (!landmark.depth) continue;
    const Eigen::Vector3d ray = landmark.ray();
    double information = 0;
    for (auto o = std::next(landmark.observations.begin()); o != landmark.observations.end(); ++o) {
      const Eigen::Isometry3d& T_c_anchor = poseOfAnchor(poses, *o, landmark);
      const Eigen::Vector3d p = projectOnRay(ray, landmark.depth->value, T_c_anchor);
      if (p.z() < kMinObserverDepthRatio) continue;
      information += (depthDerivative(p, T_c_anchor) / (p.z() * o->sigma)).squaredNorm();
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

void LocalMap::removeOutliers() {
  const auto poses = relativePoses();
  removeLandmarks([&](Landmark* landmark) {
    if (!landmark->depth) return false;
    if (landmark->depth->value <= 0) return true;
    const Eigen::Vector3d ray = landmark->ray();
    std::vector<Observation>& observations = landmark->observations;
    const auto kept = std::remove_if(
        std::next(observations.begin()), observations.end(), [&](const Observation& o) {
          const auto p =
              projectOnRay(ray, landmark->depth->value, poseOfAnchor(poses, o, *landmark));
          return reprojectionError(p, o.x) > kMaxAdjustedError;
        });
    const bool removed = kept != observations.end();
    observations.erase(kept, observations.end());
    return removed && observations.size() < 2;
  });
}

std::optional<WorldPoint> LocalMap::point(std::uint64_t id) const {
  const Landmark* const landmark = find(id);
  return landmark ? point(*landmark) : std::nullopt;
}

std::optional<WorldPoint> LocalMap::point(const Landmark& landmark) const {
  if (!landmark.depth || landmark.depth->value <= 0) return std::nullopt;
  const Eigen::Isometry3d& T_w_a = keyframe(landmark.observations.front().keyframe).T_w_c;
  const double rho = landmark.depth->value;
  const Eigen::Vector3d ray = landmark.ray();
  return WorldPoint{T_w_a * (ray / rho),
                    T_w_a.linear() * ray * (landmark.depth->sigma / (rho * rho))};
}

}  // namespace gsv
