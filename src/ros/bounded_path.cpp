#include "ground_scale_vo/ros/bounded_path.hpp"

#include <algorithm>
#include <cmath>

namespace ground_scale_vo {
namespace {

double distance(const geometry_msgs::Point& a, const geometry_msgs::Point& b) {
  return std::hypot(a.x - b.x, a.y - b.y, a.z - b.z);
}

/// [m] least spacing after a thinning: an initial spacing may be zero.
constexpr double kMinDoubledSpacing = 0.1;

}  // namespace

BoundedPath::BoundedPath(std::size_t max_poses, double spacing_m)
    : max_poses_(max_poses), initial_spacing_m_(spacing_m), spacing_m_(spacing_m) {}

bool BoundedPath::add(const geometry_msgs::PoseStamped& pose) {
  if (!poses_.empty() && distance(poses_.back().pose.position, pose.pose.position) < spacing_m_) {
    return false;
  }
  if (poses_.size() == max_poses_) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < poses_.size(); i += 2) poses_[kept++] = poses_[i];
    poses_.resize(kept);
    spacing_m_ = std::max(2.0 * spacing_m_, kMinDoubledSpacing);
  }
  poses_.push_back(pose);
  return true;
}

void BoundedPath::clear() {
  poses_.clear();
  spacing_m_ = initial_spacing_m_;
}

}  // namespace ground_scale_vo
