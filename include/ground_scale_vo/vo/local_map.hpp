#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <iterator>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/common/se3.hpp"
#include "ground_scale_vo/vo/triangulation.hpp"

namespace ground_scale_vo {

struct Observation {
  std::uint32_t keyframe = 0;
  Eigen::Vector2d x = Eigen::Vector2d::Zero();  ///< normalised image coordinates, z = 1
  double sigma = 0;                             ///< standard deviation of x, > 0
  /// [px] displacement of x from the keyframe's image, see Feature::to_stamp.
  Eigen::Vector2d to_stamp = Eigen::Vector2d::Zero();
};

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
  struct Options {
    int keyframes = 14;
    double max_relative_sigma = 0.35;
    double max_reprojection_error = 0.004;
    double max_adjusted_error = 0.003;
    double keyframe_parallax = 0.035;
    double keyframe_min_tracked = 0.6;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("keyframes", self.keyframes, 3, 1000, "[keyframes] largest number");
      visit("max_relative_sigma", self.max_relative_sigma, 0.01, 10,
            "[] largest sigma of a new inverse depth, relative to the inverse depth");
      visit("max_reprojection_error", self.max_reprojection_error, 1e-6, 0.1,
            "[focal lengths] largest error of any observation of a new landmark depth");
      visit("max_adjusted_error", self.max_adjusted_error, 1e-5, 1,
            "[focal lengths] of an observation after bundle adjustment; larger ones are removed");
      visit("keyframe_parallax", self.keyframe_parallax, 1e-4, 1,
            "[rad] median parallax to the last keyframe above which a new one is made");
      visit("keyframe_min_tracked", self.keyframe_min_tracked, 0, 1,
            "[] share of the last keyframe's features below which a new one is made");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit LocalMap(const Options& options);

  struct Corner {
    std::uint64_t id = 0;
    Eigen::Vector2d x = Eigen::Vector2d::Zero();         ///< normalised image coordinates, z = 1
    double sigma = 0;                                    ///< standard deviation of x, > 0
    Eigen::Vector2d to_stamp = Eigen::Vector2d::Zero();  ///< [px] see Feature::to_stamp
  };
  /// Adds the corners as observations of the new keyframe; unknown ids become landmarks. The image
  /// is shared, not copied. Drops the oldest keyframe when there are too many. Returns the new id.
  std::uint32_t addKeyframe(const Eigen::Isometry3d& T_w_c, const std::vector<Corner>& corners,
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

  /// Of the landmarks with a depth: removes observations with a larger error, in normalised image
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

  Options options_;
  std::deque<Keyframe> keyframes_;
  Landmarks landmarks_;
};

}  // namespace ground_scale_vo
