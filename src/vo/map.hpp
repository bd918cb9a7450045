#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <iterator>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "vo/feature.hpp"

namespace ground_scale_vo {

/// [normalised image coordinates] largest error of an observation after bundle adjustment: 2 px at
/// a focal length of 718.
constexpr double kMaxAdjustedError = 0.003;
constexpr std::size_t kMaxKeyframes = 14;  ///< of a map: some are older than the adjusted ones

/// A point on the ray of its anchor camera: p_anchor = ray / inverse_depth, ray.z() = 1.
struct InverseDepth {
  double value = 0;  ///< 1 / z in the anchor camera
  double sigma = 0;  ///< standard deviation of value
};

/// Observation of a point on the ray of an anchor camera by another camera c.
struct RayObservation {
  Eigen::Isometry3d T_c_anchor = Eigen::Isometry3d::Identity();
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
};

/// Projection of a point on the anchor's ray into camera c: p = R_c_anchor ray + inverse_depth t.
struct RayProjection {
  Eigen::Vector3d p;  ///< the point in camera c, times its inverse depth in the anchor
  /// p.z() times the derivative of p.head<2>() / p.z() with respect to the inverse depth.
  Eigen::Vector2d scaled_derivative;
};
inline RayProjection projectOnRay(const Eigen::Vector3d& ray, double inverse_depth,
                                  const Eigen::Isometry3d& T_c_anchor) {
  const Eigen::Vector3d& t = T_c_anchor.translation();
  const Eigen::Vector3d p = T_c_anchor.linear() * ray + inverse_depth * t;
  return {p, t.head<2>() - p.head<2>() / p.z() * t.z()};
}

/// Minimum depth in the observer relative to the depth in the anchor; a point with a smaller ratio
/// is treated as behind the camera.
constexpr double kMinObserverDepthRatio = 1e-6;

/// Distance between the projection of a point and its observation x, in normalised image
/// coordinates; infinite behind the camera.
inline double reprojectionError(const Eigen::Vector3d& p, const Eigen::Vector2d& x) {
  return p.z() > kMinObserverDepthRatio ? (p.head<2>() / p.z() - x).norm()
                                        : std::numeric_limits<double>::infinity();
}

/// Inverse depth with the least squared reprojection error in all observations (without the
/// anchor's own), by Gauss-Newton. ray: in the anchor, z = 1. Empty when there is no observation or
/// no baseline, the point is behind an observing camera, or the iteration does not converge. The
/// value may be zero or negative: a point at infinity, or behind the anchor.
std::optional<InverseDepth> triangulate(const Eigen::Vector3d& ray,
                                        const std::vector<RayObservation>& observations);

/// A feature's place in an image: in a frame, or in a keyframe that a landmark was observed by.
struct Observation {
  std::uint64_t id = 0;                                ///< of the feature and its landmark
  Eigen::Vector2d x = Eigen::Vector2d::Zero();         ///< normalised image coordinates, z = 1
  double sigma = 0;                                    ///< standard deviation of x, > 0
  Eigen::Vector2d to_stamp = Eigen::Vector2d::Zero();  ///< [px] see Feature::to_stamp
  std::uint32_t keyframe = 0;                          ///< id; set by LocalMap
};

/// The features at their places in this camera's image.
std::vector<Observation> observationsOf(const PinholeCamera& camera,
                                        const std::vector<Feature>& features);

/// A corner observed in keyframes, with or without a depth yet. The keyframe of its first
/// observation is its anchor: it is parametrised by its inverse depth on that ray, so the anchor's
/// own observation has no residual.
struct Landmark {
  std::vector<Observation> observations;  ///< by keyframe; never empty
  std::optional<InverseDepth> depth;      ///< in the anchor keyframe
  int outlier_count = 0;                  ///< consecutive frames in which it was an outlier

  Eigen::Vector3d ray() const { return observations.front().x.homogeneous(); }
};

/// Landmarks by id: one array ordered by id, like a std::map<std::uint64_t, Landmark> otherwise.
/// Each frame looks most landmarks up several times, and an array takes far fewer cache misses.
class Landmarks {
 public:
  using Entry = std::pair<std::uint64_t, Landmark>;  // id; do not change it
  using iterator = std::vector<Entry>::iterator;
  using const_iterator = std::vector<Entry>::const_iterator;

  std::size_t size() const { return entries_.size(); }
  bool empty() const { return entries_.empty(); }
  iterator begin() { return entries_.begin(); }
  iterator end() { return entries_.end(); }
  const_iterator begin() const { return entries_.begin(); }
  const_iterator end() const { return entries_.end(); }

  /// end() when there is none.
  iterator find(std::uint64_t id) { return begin() + (std::as_const(*this).find(id) - begin()); }
  const_iterator find(std::uint64_t id) const {
    const auto it = std::lower_bound(begin(), end(), id, isBefore);
    return it != end() && it->first == id ? it : end();
  }
  /// Precondition: there is such a landmark.
  const Landmark& at(std::uint64_t id) const { return find(id)->second; }
  /// Adds a landmark when there is none; at the end, where most are added, in constant time.
  Landmark& operator[](std::uint64_t id) {
    auto it = entries_.empty() || entries_.back().first < id
                  ? end()
                  : std::lower_bound(begin(), end(), id, isBefore);
    if (it == end() || it->first != id) it = entries_.emplace(it, id, Landmark());
    return it->second;
  }

  void clear() { entries_.clear(); }
  /// Removes the landmarks for which remove(Landmark&) is true. It is called for each one, in the
  /// order of their ids, and may change the landmark.
  template <typename Remove>
  void removeIf(const Remove& remove) {
    auto kept = begin();
    for (Entry& entry : entries_) {
      if (remove(entry.second)) continue;
      if (&*kept != &entry) *kept = std::move(entry);
      ++kept;
    }
    entries_.erase(kept, end());
  }

 private:
  static bool isBefore(const Entry& entry, std::uint64_t id) { return entry.first < id; }

  std::vector<Entry> entries_;
};

/// Finds landmarks one after the other; ascending ids take one walk over all landmarks together. No
/// landmark must be added or removed meanwhile.
template <typename Map>  // Landmarks or const Landmarks
class LandmarkWalk {
 public:
  explicit LandmarkWalk(Map& landmarks)
      : begin_(landmarks.begin()), end_(landmarks.end()), next_(begin_) {}

  /// Null when there is none.
  auto find(std::uint64_t id) {
    if (next_ != begin_ && std::prev(next_)->first >= id) next_ = begin_;
    while (next_ != end_ && next_->first < id) ++next_;
    return next_ != end_ && next_->first == id ? &next_->second : nullptr;
  }

 private:
  using Iterator = decltype(std::declval<Map&>().begin());
  const Iterator begin_, end_;
  Iterator next_;  // all before it are less than the last id
};

/// A frame whose pose is kept and optimised.
struct Keyframe {
  std::uint32_t id = 0;                                     ///< consecutive within a map, from 0
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();  ///< VO units
  cv::Mat image;             ///< 8-bit grey, reference for patch alignment; may be empty
  double exposure = 1;       ///< of the image, relative to the map's first
  std::size_t corners = 0;   ///< number observed when it was added
  bool has_parallax = true;  ///< to the keyframe before it
  Vector6d readout_motion = Vector6d::Zero();  ///< see VoFrame
};

/// A landmark in world coordinates, VO units.
struct WorldPoint {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  /// One standard deviation of p_w, along the anchor's ray.
  Eigen::Vector3d sigma_w = Eigen::Vector3d::Zero();
};

/// The last keyframes and the landmarks that they observe. When the oldest keyframe is dropped,
/// landmarks that the newest keyframe does not observe and that have fewer than two observations
/// left are removed. The others that were anchored in it are anchored in the keyframe of their next
/// observation.
class LocalMap {
 public:
  /// Adds the corners as observations of the new keyframe; unknown ids become landmarks. The image
  /// is shared, not copied. Drops the oldest keyframe when there are too many. Returns the new id.
  std::uint32_t addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Observation>& corners,
                            const cv::Mat& image = {});

  /// Removes the newest keyframe, its observations, and the landmarks that no other keyframe
  /// observes. Precondition: there is another keyframe.
  void removeNewestKeyframe();

  /// Triangulates the landmarks without depth. A landmark receives a depth if it is accurate enough
  /// and consistent with all observations.
  void triangulateNew();

  /// Recomputes the sigma of the depths from their observations. It is kept where only the anchor's
  /// observation is left, and does not increase where only one other is left.
  void updateSigmas();

  /// Removes observations of landmarks with a depth that have a larger error, in normalised image
  /// coordinates. Removes a landmark that thereby keeps only the observation in the anchor, and one
  /// whose inverse depth is not positive.
  void removeOutliers(double max_reprojection_error);

  void clear();

  /// Null when there is none.
  Landmark* find(std::uint64_t id);
  /// Empty when there is no such landmark, or it has no positive depth.
  std::optional<WorldPoint> point(std::uint64_t id) const;
  std::optional<WorldPoint> point(const Landmark& landmark) const;
  /// The same; also empty when the landmark is null.
  std::optional<WorldPoint> pointOf(const Landmark* landmark) const {
    return landmark ? point(*landmark) : std::nullopt;
  }

  std::deque<Keyframe>& keyframes() { return keyframes_; }
  const std::deque<Keyframe>& keyframes() const { return keyframes_; }
  /// Precondition: the keyframe is kept.
  const Keyframe& keyframe(std::uint32_t id) const {
    return keyframes_[id - keyframes_.front().id];
  }
  Landmarks& landmarks() { return landmarks_; }
  const Landmarks& landmarks() const { return landmarks_; }

 private:
  void dropOldestKeyframe();
  std::optional<InverseDepth> depthInAnchor(const Landmark& landmark,
                                            const WorldPoint& world) const;

  std::deque<Keyframe> keyframes_;
  Landmarks landmarks_;
};

}  // namespace ground_scale_vo
