#pragma once

#include <geometry_msgs/PoseStamped.h>

#include <cstddef>
#include <vector>

namespace ground_scale_vo {

/// A path with a bounded number of poses, for display. Poses are at least a spacing apart. A full
/// path drops every second pose and doubles the spacing, so the size of the message does not grow
/// with the length of the drive.
class BoundedPath {
 public:
  /// Preconditions: max_poses >= 2, spacing_m >= 0.
  BoundedPath(std::size_t max_poses, double spacing_m);

  /// True if the pose was added.
  bool add(const geometry_msgs::PoseStamped& pose);
  void clear();
  const std::vector<geometry_msgs::PoseStamped>& poses() const { return poses_; }

 private:
  const std::size_t max_poses_;
  const double initial_spacing_m_;
  double spacing_m_;
  std::vector<geometry_msgs::PoseStamped> poses_;
};

}  // namespace ground_scale_vo
