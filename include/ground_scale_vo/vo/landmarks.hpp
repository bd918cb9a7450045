#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

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

}  // namespace ground_scale_vo
